"""Lengths from bags, written by rosbags and by the library of MCAP: stamps, names, the guess of the topic, damage."""

import struct
import tomllib

import numpy as np
import pytest
import tomli_w

import tensegraph as tg
from command_line import refusal_of, run
from tensegraph import Flag, InputError
from tensegraph.io.length_files.lengths_bag import LengthsBag

pytest.importorskip("rosbags")

EPOCH_NS = 1_700_000_000_250_000_000
"""Of the first message; they come at 50 Hz, and are recorded 3 ms late."""


@pytest.fixture(scope="module")
def ros():
    """The types of ROS 2."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def joint_state(ros, stamp_ns: int, values, names=()):
    t = ros.types
    stamp = t["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    header = t["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    none = np.empty(0)
    values = np.asarray(values, dtype=np.float64)
    return t["sensor_msgs/msg/JointState"](header=header, name=list(names), position=values, velocity=none, effort=none)


def multi_array(ros, values, offset: int = 0):
    t = ros.types
    layout = t["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=offset)
    return t["std_msgs/msg/Float64MultiArray"](layout=layout, data=np.asarray(values, dtype=np.float64))


def write_bag(ros, path, topics, storage="mcap") -> None:
    """Write the messages of each topic."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        for topic, messages in topics.items():
            kind = messages[0].__msgtype__
            connection = writer.add_connection(topic, kind, typestore=ros)
            for k, message in enumerate(messages):
                recorded_ns = EPOCH_NS + k * 20_000_000 + 3_000_000
                writer.write(connection, recorded_ns, ros.serialize_cdr(message, kind))


@pytest.fixture
def trial_with(example, tmp_path):
    """A trial whose lengths are those of a table `[lengths]`; its natural lengths are those of the example."""

    def make(**lengths):
        table = tomllib.loads((example / "trial.toml").read_text())
        kept = {name: table[name] for name in ("structure", "mechanics", "rest")} | {"lengths": lengths}
        (tmp_path / "trial.toml").write_text(tomli_w.dumps(kept))
        return tmp_path

    return make


def natural_m(example) -> np.ndarray:
    return tg.open_trial(example).description.structure.natural_length_m


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_is_the_table_of_its_numbers(ros, example, trial_with, storage) -> None:
    """The topic is guessed: of two that could be, one has lengths of 24 tendons. Stamps are those of the headers."""
    length_m = natural_m(example) * np.linspace(1.0, 1.1, 5)[:, None]
    length_m[3, 7] = np.nan
    states = [joint_state(ros, EPOCH_NS + k * 20_000_000, row) for k, row in enumerate(length_m)]
    motors = [joint_state(ros, EPOCH_NS, [1.0, 2.0])]
    folder = trial_with(file="bag")
    write_bag(ros, folder / "bag", {"/motors": motors, "/tendon_lengths": states}, storage)
    trial = tg.open_trial(folder)
    read = list(trial.readings())
    np.testing.assert_allclose([lengths.t_s for lengths in read], [0, 0.02, 0.04, 0.06, 0.08], atol=1e-12)
    np.testing.assert_array_equal([lengths.length_m for lengths in read], length_m)
    assert read[3].flags[7] == Flag.MISSING
    assert np.isnan(read[0].sigma_m).all()  # `noise.unstated_m` stands in
    assert trial.row_count() == 5
    before = trial.hashes()["bag"]
    (folder / "bag" / "more").touch()
    assert trial.hashes()["bag"] != before


def test_arrays_have_the_time_of_their_recording(ros, example, trial_with) -> None:
    """And begin at their offset."""
    arrays = [multi_array(ros, [9.0, *natural_m(example)], offset=1)] * 3
    folder = trial_with(file="bag", topic="/lengths")
    write_bag(ros, folder / "bag", {"/lengths": arrays})
    (folder / "bag" / "bag.mcap").rename(folder / "alone.mcap")
    trial_with(file="alone.mcap", topic="/lengths")
    read = list(tg.open_trial(folder).readings())
    np.testing.assert_allclose([lengths.t_s for lengths in read], [0, 0.02, 0.04], atol=1e-12)
    np.testing.assert_array_equal(read[2].length_m, natural_m(example))


def test_headers_without_a_stamp_have_the_time_of_their_recording(ros, tmp_path) -> None:
    write_bag(ros, tmp_path / "bag", {"/l": [joint_state(ros, 0, [1, 2])] * 3})
    assert [row[0] for row in LengthsBag(tmp_path / "bag", None, range(2))] == pytest.approx([0, 0.02, 0.04])


def test_names_tell_the_tendons(ros, tmp_path) -> None:
    """In the order of the alphabet, as publishers like it, and without one."""
    names = ["t_0", "t_1", "t_10", "t_2", *(f"t_{e}" for e in range(3, 9))]
    message = joint_state(ros, EPOCH_NS, [float(name[2:]) for name in names], names)
    write_bag(ros, tmp_path / "bag", {"/l": [message]})
    ((t_s, *length_m),) = LengthsBag(tmp_path / "bag", "/l", range(11))
    assert t_s == 0
    np.testing.assert_array_equal(length_m, [0, 1, 2, 3, 4, 5, 6, 7, 8, np.nan, 10])


def test_another_library_wrote_the_bag(tmp_path) -> None:
    writer = pytest.importorskip("mcap_ros2.writer")
    with (tmp_path / "other.mcap").open("wb") as file, writer.Writer(file) as bag:
        text = "std_msgs/MultiArrayLayout layout\nfloat64[] data\n" + "=" * 80 + "\nMSG: std_msgs/MultiArrayLayout\n"
        text += "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n" + "=" * 80
        text += "\nMSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n"
        schema = bag.register_msgdef("std_msgs/msg/Float64MultiArray", text)
        for k in range(3):
            message = {"layout": {"dim": [], "data_offset": 0}, "data": [0.1 + k, 0.2]}
            bag.write_message("/l", schema, message, log_time=EPOCH_NS + k * 10**9)
    rows = list(LengthsBag(tmp_path / "other.mcap", None, range(2)))
    np.testing.assert_allclose(rows, [[0, 0.1, 0.2], [1, 1.1, 0.2], [2, 2.1, 0.2]])


def refused(bag, topic, tendons) -> str:
    with pytest.raises(InputError) as error:
        list(LengthsBag(bag, topic, range(tendons)))
    assert "\n" not in str(error.value)
    return str(error.value).removeprefix(f"{bag}: ")


def test_what_does_not_fit_is_one_line(ros, tmp_path) -> None:
    two = [joint_state(ros, EPOCH_NS, [1, 2])]
    write_bag(ros, tmp_path / "a", {"/l": [*two, joint_state(ros, EPOCH_NS + 1, [1, 2, 3])], "/m": two})
    got = "exactly one JointState or Float64MultiArray would have to hold"
    assert refused(tmp_path / "a", None, 2) == f"topic: is missing: {got} 2 lengths, got /l, /m"
    assert refused(tmp_path / "a", None, 5) == f"topic: is missing: {got} 5 lengths, got /l, /m"
    assert refused(tmp_path / "a", "/x", 2) == "topic: expected one of /l, /m, got '/x', which is not in the bag"
    assert refused(tmp_path / "a", "/l", 2) == "/l: message 2: position: expected 2 lengths, got 3"
    unstamped = [*two, joint_state(ros, 0, [1, 2])]
    write_bag(ros, tmp_path / "b", {"/l": unstamped})
    assert refused(tmp_path / "b", None, 2) == "/l: message 2: header.stamp: expected a time, as in the first, got 0"
    for names in (["a", "b"], ["t0", "t2"], ["t1", "t1"]):
        write_bag(ros, tmp_path / names[1] / names[0], {"/l": [joint_state(ros, EPOCH_NS, [1, 2], names)]})
        assert "expected names that end in the number of a tendon" in refused(tmp_path / names[1] / names[0], "/l", 2)
    assert "a tendon with a sensor, of which there is none" in refused(tmp_path / "t1" / "t1", "/l", 0)
    assert refused(tmp_path / "no.mcap", None, 2) == "no such file"


def test_a_damaged_bag_is_one_line(ros, tmp_path) -> None:
    """Cut anywhere, it is read or refused, and never a traceback."""
    write_bag(ros, tmp_path / "whole", {"/l": [joint_state(ros, EPOCH_NS + k, [1, 2]) for k in range(50)]})
    data = (tmp_path / "whole" / "whole.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    for end in range(0, len(data), len(data) // 23):
        cut.write_bytes(data[:end])
        assert refused(cut, None, 2)
    (summary,) = struct.unpack("<Q", data[-28:-20])
    endless = struct.pack("<Q", 1 << 60)  # bytes of the first record of the summary
    cut.write_bytes(data[: summary + 1] + endless + data[summary + 9 :])
    assert refused(cut, None, 2) == "cannot be read as a bag: it is damaged"
    cut.write_bytes(b"not a bag at all")
    assert refused(cut, None, 2).startswith("cannot be read as a bag: ")


@pytest.mark.parametrize(
    ("told", "instead", "message"),
    [
        ("message_count: 3\n", "message_count: null\n", "/l: message_count: expected a number of messages, got None"),
        ("message_count: 3\n", "message_count: .inf\n", "/l: message_count: expected a number of messages, got inf"),
        ("message_count: 3\n", "message_count: -5\n", "/l: message_count: expected a number of messages, got -5"),
        ("name: /l\n", "name: []\n", ""),
        ("version: ", "edition: ", "cannot be read as a bag: metadata.yaml is not that of a bag"),
        ("version: ", "version: ~ #", "cannot be read as a bag: metadata.yaml is not that of a bag"),
    ],
)
def test_metadata_that_are_none_are_one_line(told, instead, message, ros, tmp_path) -> None:
    write_bag(ros, tmp_path / "bag", {"/l": [joint_state(ros, EPOCH_NS + k, [1, 2]) for k in range(3)]})
    path = tmp_path / "bag" / "metadata.yaml"
    text = path.read_text()
    assert told in text
    path.write_text(text.replace(told, instead))
    assert message in refused(tmp_path / "bag", None, 2)


def test_odd_metadata_do_not_warn(ros, tmp_path) -> None:
    """The reader of YAML warns of an anchor that is used twice; every warning is an error here."""
    write_bag(ros, tmp_path / "bag", {"/l": [joint_state(ros, EPOCH_NS + k, [1, 2]) for k in range(3)]})
    path = tmp_path / "bag" / "metadata.yaml"
    path.write_text(path.read_text().replace("version: ", "a: &a 1\n  b: &a 2\n  version: "))
    assert len(list(LengthsBag(tmp_path / "bag", None, [0, 1]))) == 3


@pytest.mark.parametrize(
    ("kind", "field", "damaged"),
    [
        ("array", b"data_offset", b"dqta_offset"),
        ("state", b"float64[] position", b"float64[] posjtion"),
        ("state", b"nanosec", b"nbnosec"),
        ("state", b"Header header", b"Header heqder"),
    ],
)
def test_a_definition_with_a_flipped_bit_is_one_line(kind, field, damaged, ros, tmp_path) -> None:
    messages = [multi_array(ros, [1, 2])] if kind == "array" else [joint_state(ros, EPOCH_NS, [1, 2])]
    write_bag(ros, tmp_path / "whole", {"/l": messages})
    data = (tmp_path / "whole" / "whole.mcap").read_bytes()
    assert field in data
    (tmp_path / "damaged.mcap").write_bytes(data.replace(field, damaged))
    said = refused(tmp_path / "damaged.mcap", "/l", 2)
    assert said.startswith(("/l: message 1: its fields are not those of its type: ", "cannot be read as a bag: "))
    assert "\n" not in said


def test_as_a_user_types_it(ros, example, trial_with) -> None:
    """The table in trial.toml, and what is wrong with it."""
    folder = trial_with(file="bag", topic="/tendon_lengths")
    length_m = natural_m(example) * 1.08
    states = [joint_state(ros, EPOCH_NS + k * 20_000_000, length_m) for k in range(20)]
    write_bag(ros, folder / "bag", {"/tendon_lengths": states})
    made = run("reconstruct", folder, "--figures", "none", "--out", "result", cwd=folder)
    assert (made.returncode, made.stderr) == (0, "")
    result = tg.load(folder / "result")
    assert len(result) == 20
    np.testing.assert_allclose(result.predicted_m[-1], length_m, atol=0.01)
    trial_with(file="lengths.csv", topic="/tendon_lengths")
    (folder / "lengths.csv").touch()
    wrong = refusal_of("reconstruct", folder, "--figures", "none", "--out", "result", cwd=folder)
    assert "lengths.topic: goes with a bag: expected none with lengths.csv" in wrong
