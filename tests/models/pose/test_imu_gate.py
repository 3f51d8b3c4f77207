"""Samples of inertial sensors that are absurd, or stuck."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph.models.pose.imu_gate import ImuGate
from tensegraph.models.values.aids import ImuReading
from tensegraph.models.values.stamps import RestClock


def sample(k: int, rate: float = 0.1, force: float = 9.8) -> ImuReading:
    return ImuReading(0, 0.01 * k, np.array([rate, 0, 0]), np.array([0, 0, force]))


def test_what_no_sensor_can_measure_is_left_out() -> None:
    gate = ImuGate(1, RestClock(0.0))
    passed = [gate.passes(reading) for reading in (sample(0), sample(1, rate=900), sample(2, force=-5000), sample(3))]
    assert passed == [True, False, False, True]
    assert gate.counts()["imu 0: absurd samples"] == 2


def test_a_rate_that_jumps_is_left_out_unless_it_is_confirmed() -> None:
    """A lost decimal point in one row; a real blow lasts for longer than one sample."""
    gate = ImuGate(1, RestClock(0.0))
    rates = [0.1, -17.0, 0.2, 0.3, 14.0, 15.0, 14.0, 1.0, 1.1]
    passed = [gate.passes(sample(k, rate=rate)) for k, rate in enumerate(rates)]
    assert passed == [True, False, True, True, False, True, True, False, True]
    assert gate.counts()["imu 0: absurd samples"] == 3


@pytest.mark.parametrize(
    ("rate", "expected"),
    [(0.01, [True, False, True, False, True, True]), (0.3, [True] * 6)],
    ids=["still", "turning"],
)
def test_a_force_that_jumps_while_nothing_turns_is_left_out_unless_it_is_confirmed(rate, expected) -> None:
    """An axis that reads 0 in one row; a sensor that turns may be hit."""
    gate = ImuGate(1, RestClock(0.0))
    forces = [9.8, 0.0, 9.7, 12.0, 12.5, 12.4]
    assert [gate.passes(sample(k, rate=rate, force=force)) for k, force in enumerate(forces)] == expected


def test_a_force_that_grows_from_sample_to_sample_is_a_lift() -> None:
    """Each change is larger than a jump; the second confirms the first."""
    gate = ImuGate(1, RestClock(0.0))
    forces = [9.8, 9.8, 11.0, 12.4, 13.7, 15.0, 15.1]
    passed = [gate.passes(sample(k, rate=0.01, force=force)) for k, force in enumerate(forces)]
    assert passed == [True, True, False, True, False, True, True]


@pytest.mark.parametrize("damaged", [(0.0, 30.0), (0.0, 7.0), (0.0, 14.0), (-200.0, 50.0), (12.0, 40.0)])
def test_two_damaged_samples_do_not_confirm_each_other(damaged) -> None:
    gate = ImuGate(1, RestClock(0.0))
    forces = [9.8, 9.8, *damaged, 9.7]
    passed = [gate.passes(sample(k, rate=0.01, force=force)) for k, force in enumerate(forces)]
    assert passed == [True, True, False, False, True]


def test_a_sensor_that_repeats_itself_is_stuck_until_it_moves() -> None:
    """Four equal samples may be chance; the fifth and all that follow are left out."""
    gate = ImuGate(1, RestClock(0.0))
    passed = [gate.passes(sample(k)) for k in range(8)]
    assert passed == [True] * 4 + [False] * 4
    assert gate.passes(sample(9, rate=0.2))
    assert gate.counts()["imu 0: stuck samples"] == 4


@pytest.mark.parametrize(
    ("every", "reads", "expected"),
    [(1, 1, None), (2, 1, None), (4, 1, "0.04"), (1, 5, "0.05")],
    ids=["100 Hz", "50 Hz", "25 Hz", "20 Hz, each read five times"],
)
def test_a_sensor_that_measures_too_rarely_is_told(every: int, reads: int, expected: str | None) -> None:
    gate, rng = ImuGate(1, RestClock(0.0)), np.random.default_rng(4)
    for k in range(600):
        if k % reads == 0:
            rate = float(rng.normal(0, 0.005))
        gate.passes(sample(every * k, rate=rate))
    told = gate.warnings().get("imu 0")
    assert told is None if expected is None else told.startswith(f"a new sample each {expected} s:")


def test_pauses_are_no_slow_samples_and_a_wrong_unit_comes_first() -> None:
    gate, rng = ImuGate(1, RestClock(0.0)), np.random.default_rng(4)
    for k in range(400):
        gate.passes(replace(sample(k, rate=float(rng.normal(0, 0.005))), t_s=0.01 * k + (600.0 if k > 200 else 0.0)))
    assert "imu 0" not in gate.warnings()
    in_degrees = ImuGate(1, RestClock(0.0))
    for k in range(400):
        in_degrees.passes(sample(4 * k, rate=float(rng.normal(500, 100))))
    assert "unit?" in in_degrees.warnings()["imu 0"]


def test_samples_that_are_stamped_on_arrival_in_packets_are_told() -> None:
    rng, gates = np.random.default_rng(4), [ImuGate(1, RestClock(0.0)) for _ in range(2)]
    for k in range(400):
        measured = sample(k, rate=float(rng.normal(0, 0.005)))
        arrived_s = 0.1 * np.ceil(measured.t_s / 0.1 - 1e-9) + 1e-4 * (k % 10)
        for gate, t_s in zip(gates, (measured.t_s + rng.uniform(0, 0.003), arrived_s), strict=True):
            gate.passes(replace(measured, t_s=t_s))
    assert gates[0].warnings().get("imu 0") is None
    assert gates[1].warnings()["imu 0"].startswith("most samples come in packets")


def test_a_sensor_that_is_noisy_or_shaken_while_it_does_not_turn_is_used() -> None:
    """Vibration of a motor, and 3 cm to and fro at 2 Hz at 50 samples a second."""
    rng = np.random.default_rng(4)
    swing = 0.03 * (2 * np.pi * 2) ** 2 * np.sin(2 * np.pi * 2 * 0.02 * np.arange(500))
    for forces in (9.8 + rng.normal(0, 1.0, 500), 9.8 + swing):
        gate = ImuGate(1, RestClock(0.0))
        passed = [gate.passes(sample(k, rate=rng.normal(0, 0.005), force=force)) for k, force in enumerate(forces)]
        assert np.mean(passed) > 0.95


@pytest.mark.parametrize(
    ("resolution", "stuck_axis", "least", "most"),
    [(1e-6, 1, 11, 11), (1e-6, None, 0, 0), (0.003, None, 0, 10), (0.1, None, 0, 0)],
    ids=["stuck", "fine", "coarse", "too coarse"],
)
def test_one_axis_that_repeats_itself_while_the_others_change_is_stuck(resolution, stuck_axis, least, most) -> None:
    """Until it moves. Where the resolution is coarse, each axis repeats itself for long, and hardly ever alone."""
    rng = np.random.default_rng(5)
    gate = ImuGate(1, RestClock(0.0))
    for k in range(50 if stuck_axis is not None else 2000):
        rate = resolution * np.round(rng.normal(0, 1e-3, 3) / resolution)
        if stuck_axis is not None and k < 30:
            rate[stuck_axis] = 0.01
        gate.passes(ImuReading(0, 0.01 * k, rate, np.array([0, 0, 9.8]) + rng.normal(0, 0.03, 3)))
    assert least <= gate.stuck[0] <= most


def test_axes_that_never_move_in_a_simulation_without_noise_are_not_stuck() -> None:
    gate = ImuGate(1, RestClock(0.0))
    for k in range(300):
        force = 9.8 * np.array([0, np.sin(0.01 * k), np.cos(0.01 * k)])
        assert gate.passes(ImuReading(0, 0.01 * k, np.array([0.1 + 0.001 * k, 0, 0]), force))


def test_frames_without_samples_are_counted() -> None:
    """By hand: silent for more than 0.2 s in the frames of 0.3, 0.4 and 0.5 s; another sensor never says anything."""
    gate = ImuGate(2, RestClock(0.0))
    for k in range(8):
        if k not in (1, 2, 3, 4, 5):
            gate.passes(ImuReading(0, 0.1 * k, np.zeros(3), np.full(3, float(k))))
        gate.count_frame(0.1 * k)
    assert gate.counts()["imu 0: silent frames"] == 3
    assert gate.counts()["imu 1: silent frames"] == 5


def test_of_a_sensor_that_is_mostly_absurd_nothing_is_used() -> None:
    """By hand: two of the first three samples are absurd, and three of six are not most."""
    gate = ImuGate(1, RestClock(0.0))
    absurd = [True, False, True, False, False, True]
    passed = [gate.passes(sample(k, rate=0.1 + k, force=9810.0 if wrong else 9.8)) for k, wrong in enumerate(absurd)]
    assert passed == [False, True, False, True, True, False]
    assert gate.warnings() == {}
    gate.passes(sample(6, force=9810.0))
    assert gate.warnings() == {"imu 0": "most samples are absurd, and none is used: unit?"}


@pytest.mark.parametrize("first_s", [0.0, 100.0])
def test_a_unit_that_is_told_wrongly_is_named(first_s) -> None:
    """At rest alone, which lasts for 0.05 s from the first frame on: later a robot may be accelerated."""
    gate = ImuGate(3, RestClock(0.05))
    for k in range(10):
        t_s, moves = first_s + 0.01 * k, 1.0 if k < 5 else 3.0
        gate.passes(ImuReading(0, t_s, np.full(3, 0.01 * k), np.array([0, 0.6, 0.8])))
        gate.passes(ImuReading(1, t_s, np.full(3, 0.01 * k * moves), moves * np.array([0, 6.0, 8.0])))
        gate.passes(ImuReading(2, t_s, np.rad2deg([0.01, 0.0, 1e-3 * k]), np.array([0, 6.0, 8.0])))
        gate.count_frame(t_s)
    assert gate.warnings() == {
        "imu 0": "specific force at rest: expected 9.81 m/s^2, got 1: unit?",
        "imu 2": "rate at rest: expected about 0 rad/s, got 0.584: unit, or is it moved?",
    }
