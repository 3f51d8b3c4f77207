"""A recording for ROS 2, read by the reader of MCAP; one for Rerun; films, decoded by ffmpeg."""

import resource
import subprocess
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensegraph as tg
from tensegraph.io.figures.film import film_times_s


@pytest.fixture(scope="module")
def messages(short_run, tmp_path_factory):
    """The messages of each topic, and the recording's folder."""
    pytest.importorskip("rosbags")
    reader = pytest.importorskip("mcap_ros2.reader")
    folder = tmp_path_factory.mktemp("ros2")
    (path,) = tg.export(short_run, folder / "run.mcap", probability=0.5)
    topics = {}
    for message in reader.read_ros2_messages(path):
        topics.setdefault(message.channel.topic, []).append(message)
    assert [file.name for file in folder.iterdir()] == ["run.mcap"]
    return topics


def test_each_node_has_a_pose_in_every_frame(messages, short_run) -> None:
    poses = messages["/tensegraph/node_7/pose"]
    assert poses[0].schema.name == "geometry_msgs/msg/PoseWithCovarianceStamped"
    assert len(poses) == len(short_run)
    header, pose = poses[4].ros_msg.header, poses[4].ros_msg.pose
    assert header.frame_id == "anchors"
    assert header.stamp.sec + 1e-9 * header.stamp.nanosec == pytest.approx(short_run.t_s[4], abs=1e-9)
    assert poses[4].log_time_ns == round(1e9 * short_run.t_s[4])
    position = pose.pose.position
    np.testing.assert_array_equal([position.x, position.y, position.z], short_run.node_position_m[4, 7])
    covariance = np.reshape(pose.covariance, (6, 6))
    np.testing.assert_array_equal(covariance[:3, :3], short_run.node_covariance_m2[4, 7])
    assert covariance[3, 3] > 3  # an angle of which nothing is known


def test_each_rod_has_a_frame_along_it(messages, short_run) -> None:
    transforms = messages["/tf"][4].ros_msg.transforms
    assert [transform.child_frame_id for transform in transforms] == [f"rod_{k}" for k in range(6)]
    moved, (a, b) = transforms[2].transform, short_run.structure.rods[2]
    turn = Rotation.from_quat([getattr(moved.rotation, axis) for axis in "xyzw"])
    middle_m = np.array([getattr(moved.translation, axis) for axis in "xyz"])
    half_m = 0.5 * np.linalg.norm(short_run.node_position_m[4, b] - short_run.node_position_m[4, a])
    np.testing.assert_allclose(middle_m + turn.apply([0, 0, half_m]), short_run.node_position_m[4, b], atol=1e-9)


def test_the_frame_of_a_rod_does_not_jump_where_it_passes_the_horizontal(short_run, tmp_path) -> None:
    """Viewers and tf2 turn a frame from one stamp to the next; it was turned by half a turn about the rod."""
    pytest.importorskip("rosbags")
    reader = pytest.importorskip("mcap_ros2.reader")
    a, b = short_run.structure.rods[2]
    position_m = np.repeat(short_run.node_position_m[:1], len(short_run), axis=0)
    position_m[:, b] = position_m[:, a] + [0.3, 0, 0]
    position_m[:, b, 2] += np.linspace(-0.01, 0.01, len(short_run))
    (path,) = tg.export(replace(short_run, node_position_m=position_m), tmp_path / "run.mcap")
    stored = reader.read_ros2_messages(path, topics=["/tf"])
    rotations = [message.ros_msg.transforms[2].transform.rotation for message in stored]
    turns = Rotation.from_quat([[getattr(rotation, axis) for axis in "xyzw"] for rotation in rotations])
    assert len(turns) == len(short_run)
    assert (turns[:-1].inv() * turns[1:]).magnitude().max() < 0.01


def test_markers_are_lines_and_ellipsoids(messages, short_run) -> None:
    markers = messages["/tensegraph/markers"][2].ros_msg.markers
    assert [marker.ns for marker in markers] == ["rod", "tendon", *["ellipsoid"] * 9]
    tendons = markers[1]
    ends = np.array([[point.x, point.y, point.z] for point in tendons.points]).reshape(24, 2, 3)
    np.testing.assert_allclose(ends, short_run.node_position_m[2][short_run.structure.tendons], atol=1e-9)
    colors = [(color.r, color.g, color.b) for color in tendons.colors[::2]]
    assert [e for e in range(24) if colors[e] != colors[0]] == [5]  # without a reading
    scale = markers[-1].scale
    semi_axis_m = short_run.ellipsoids(0.5).semi_axis_m[2, 11]
    np.testing.assert_allclose([scale.x, scale.y, scale.z], 2 * semi_axis_m)


def test_times_before_zero_are_refused(short_run, tmp_path) -> None:
    pytest.importorskip("rosbags")
    with pytest.raises(tg.InputError, match="expected times from 0 on, got -1"):
        tg.export(replace(short_run, t_s=short_run.t_s - 1), tmp_path / "run.mcap")
    assert not list(tmp_path.iterdir())


def test_a_recording_of_rerun(short_run, tmp_path) -> None:
    """Rerun stores positions with 32 bits."""
    reader = pytest.importorskip("rerun.chunk")
    (path,) = tg.export(short_run, tmp_path / "run.rrd", probability=0.5)
    stored = [chunk for chunk in reader.RrdReader(path).stream().to_chunks() if not chunk.is_static]
    chunks = {str(chunk.entity_path): chunk.to_record_batch() for chunk in stored}
    spheres = chunks["/anchors/ellipsoids"]
    assert [round(t.total_seconds(), 4) for t in spheres["t_s"].to_pylist()] == np.round(short_run.t_s, 4).tolist()
    free = short_run.structure.free_nodes
    semi_axis_m = short_run.ellipsoids(0.5).semi_axis_m[:, free]
    for entity, scale in (("ellipsoids", 1), ("ellipsoids_x10", 10)):
        half_sizes_m = np.array(chunks[f"/anchors/{entity}"]["Ellipsoids3D:half_sizes"].to_pylist())
        np.testing.assert_allclose(half_sizes_m, scale * semi_axis_m, rtol=1e-6)
    ends_m = np.array(chunks["/anchors/tendons"]["LineStrips3D:strips"].to_pylist())
    np.testing.assert_allclose(ends_m, short_run.node_position_m[:, short_run.structure.tendons], atol=1e-7)
    marks = chunks["/anchors/marked_tendons"]["Points3D:labels"].to_pylist()
    assert marks == [[], [], ["5 no reading"], *[[]] * (len(short_run) - 3)]
    lengths_m = np.array(chunks["/length_m/7"]["Scalars:scalars"].to_pylist())
    np.testing.assert_array_equal(lengths_m[:, 0], short_run.length_m[:, 7])
    np.testing.assert_allclose(lengths_m[:, 3] - lengths_m[:, 2], 2 * 1.96 * short_run.sigma_m[:, 7])
    states = [state for [state] in chunks["/status"]["StateChange:state"].to_pylist()]
    assert states == ["ok", "two_shapes", "ok", "ok: many_loads"]


@pytest.mark.parametrize("name", ["run.mp4", "run.gif"])
def test_a_film_has_a_picture_for_each_of_its_times(short_run, tmp_path, name) -> None:
    """0.48 s at 12.5 pictures a second are 7, of which the later differ from the first."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    (path,) = tg.export(short_run, tmp_path / name)
    command = [ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(command, capture_output=True, check=True, timeout=60)
    pictures = np.frombuffer(done.stdout, np.uint8).reshape(-1, 640, 640, 3).astype(int)
    assert len(pictures) == 7
    assert (pictures[0] > 200).mean() > 0.5  # a light ground
    assert np.abs(pictures[-1] - pictures[0]).max() > 50  # the time in the title, at least


@pytest.mark.parametrize("kilobytes", [1, 8])
def test_a_film_for_which_there_is_no_room_is_refused(short_run, tmp_path, kilobytes) -> None:
    """At its end, or in the middle: a file that no player opens was told as written."""
    pytest.importorskip("imageio_ffmpeg")
    limit = (kilobytes << 10, resource.getrlimit(resource.RLIMIT_FSIZE)[1])
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    try:
        with pytest.raises(tg.InputError, match=r"run\.mp4: cannot be written: the film is not whole"):
            tg.export(short_run, tmp_path / "run.mp4")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())


def test_a_film_passes_over_a_long_silence() -> None:
    """The robot was switched off for a day, which would take 36 hours to draw."""
    t_s = np.concatenate([np.arange(0, 1, 0.02), 86_400 + np.arange(0, 1, 0.02)])
    times_s = film_times_s(t_s)
    assert len(times_s) == 26
    assert times_s[12:14].tolist() == pytest.approx([0.96, 86_400.0])


def test_no_picture_is_after_the_end_of_the_run() -> None:
    """Every 0.08 s, up to 0.42 s, which steps from 0.02 s reach only after rounding; for runs of all lengths."""
    assert film_times_s(np.array([0.02, 0.42])).tolist() == pytest.approx([0.02, 0.1, 0.18, 0.26, 0.34, 0.42])
    for first, last in product(range(5), range(5, 200)):
        t_s = np.array([first, last]) / 50
        times_s = film_times_s(t_s)
        assert t_s[0] == times_s[0] <= times_s[-1] <= t_s[-1]
        assert len(times_s) == 1 + (last - first) // 4
