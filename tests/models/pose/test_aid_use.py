"""Recordings of ranges and positions of which nothing is used, and the cause that is told."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph.models.pose.aid_use import AidUse
from tensegraph.models.structure.shape import Shape, Status
from tensegraph.models.values.aids import AidReading, ImuReading, PositionReading, RangeReading

BEACON_M = np.array([3.0, 0, 0])
X = 0.15 * np.random.default_rng(3).standard_normal((12, 3))


@pytest.fixture
def shape(rest, structure, lengths_of) -> Shape:
    return Shape(0.0, rest.node_position_m, 1e-6 * np.eye(36), Status.OK, lengths_of(structure, rest.node_position_m))


def test_a_beacon_where_a_node_rests_has_no_ratio(shape) -> None:
    use = AidUse(X, 0, 1, (), is_held=False)
    use.read(RangeReading(0.0, X[2], (0, 0, 2), 0.05))
    use.observe(shape)
    use.observe(replace(shape, t_s=2.0))
    assert "contradict the robot" in use.lines()["range 0"]


def lines(shape: Shape, readings: list[AidReading], used: bool = False, is_held: bool = False) -> dict[str, str]:
    """Return what is told of a range and a recording of positions after two seconds of frames."""
    use = AidUse(X, 0, 1, (0,), is_held=is_held)
    for reading in readings:
        use.read(reading)
    for t_s in (0.0, 1.0, 2.0):
        aids = tuple(reading for reading in readings if t_s - 1 < reading.t_s <= t_s)
        outlying = tuple(reading.pair[0] for reading in aids if isinstance(reading, RangeReading) and not used)
        kept = tuple(reading for reading in aids if used or isinstance(reading, RangeReading))
        use.observe(replace(shape, t_s=t_s, lengths=replace(shape.lengths, aids=kept), outlying_ranges=outlying))
    return use.lines()


def read(scale: float = 1.0, late_s: float = 0.0) -> list[AidReading]:
    range_m = scale * float(np.linalg.norm(X[4] - BEACON_M))
    ranges = [RangeReading(late_s + 0.5, BEACON_M, (0, 0, 4), range_m)]
    return ranges + [PositionReading(late_s + 0.5, node, scale * X[node], 0) for node in (2, 4, 9)]


def test_nothing_is_told_of_recordings_that_are_used(shape) -> None:
    assert lines(shape, read(), used=True) == {}


@pytest.mark.parametrize(("scale", "told"), [(1000, "1000"), (0.001, "0.001"), (100, "100")])
def test_a_wrong_unit_is_told_by_the_ratio_of_distances(shape, scale, told) -> None:
    both = lines(shape, read(scale))
    assert both.keys() == {"range 0", "position 0"}
    assert all(f"distances are {told} times those expected: are all units m?" in text for text in both.values())


def test_frames_after_a_recording_has_ended_are_counted(shape) -> None:
    """Readings come until 0.5 s; a second later the recording is silent. With hardly any reading the unit is asked."""
    use = AidUse(X, 1, 1, (0,), is_held=False)
    for reading in read():
        use.read(reading)
    for k in range(80):
        use.count_frame(0.05 * k)
        aids = tuple(read()) if k == 10 else ()
        use.observe(replace(shape, t_s=0.05 * k, lengths=replace(shape.lengths, aids=aids)))
    assert use.counts() == {"range 0: silent frames": 49, "position 0: silent frames": 49}
    assert use.lines() == {"imu 0": "no reading used: none has come"}
    for k in range(80, 600):
        use.count_frame(0.05 * k)
    assert use.lines()["position 0"] == (
        "no reading for 569 of 600 frames, the last at 0.50 s: does it end, or is t_s not in s?"
    )


def test_another_clock_is_told_by_the_first_stamp(shape) -> None:
    for late_s in (3600, -3600):
        both = lines(shape, read(late_s=late_s), used=True)
        assert all(f"its first is at {late_s + 0.5:.2f} s" in text for text in both.values()), both
        assert both.keys() == {"range 0", "position 0"}


def test_what_contradicts_is_told_with_its_number(shape) -> None:
    assert "all 3 contradict the robot" in lines(shape, read())["position 0"]


def test_a_structure_that_anchors_hold_uses_none(shape) -> None:
    assert "anchors hold" in lines(shape, read(), used=True, is_held=True)["range 0"]


@pytest.mark.parametrize("is_held", [False, True])
@pytest.mark.parametrize(
    ("late_s", "told"),
    [(0.0, None), (3600.0, "of the same clock?"), (-3600.0, "of the same clock?"), (None, "none has come")],
)
def test_an_inertial_sensor_of_another_clock_is_told(shape, is_held, late_s, told) -> None:
    """Or one that is silent; also on anchors, where a base that moves is told by it."""
    use = AidUse(X, 1, 0, (), is_held=is_held)
    samples = () if late_s is None else (ImuReading(0, late_s + 0.5, np.zeros(3), np.zeros(3)),)
    for sample in samples:
        use.read(sample)
    for t_s in (0.0, 1.0, 2.0):
        aids = tuple(one for one in samples if t_s - 1 < one.t_s <= t_s)
        use.observe(replace(shape, t_s=t_s, lengths=replace(shape.lengths, aids=aids)))
    line = use.lines().get("imu 0")
    assert (line is None) if told is None else told in line


@pytest.mark.parametrize(("of_the_time", "is_told"), [(1, True), (9, False)])
def test_a_recording_of_which_a_little_is_of_the_time_is_told(shape, of_the_time, is_told) -> None:
    """As one in milliseconds that begins with the trial is: its first rows are used."""
    readings: list[AidReading] = [RangeReading(0.5, BEACON_M, (0, 0, 4), 3.0)] * of_the_time
    readings += [RangeReading(16.4 * k, BEACON_M, (0, 0, 4), 3.0) for k in range(1, 21)]
    told = f"20 of {20 + of_the_time} readings, 0.50 to 328.00 s, are not of the time of the frames, 0.00 to 2.00 s"
    assert (told in lines(shape, readings, used=True).get("range 0", "")) == is_told
