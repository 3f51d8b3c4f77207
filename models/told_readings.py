"""Readings that a program tells: each is of a sensor of the trial, of a time, and has as many values as that has.

Rows of counts are checked where they are converted (`CountConverter`), lengths where they are used (`ToldLengths`).
"""

from collections.abc import Collection
from numbers import Integral

import numpy as np
from numpy.typing import NDArray

from .trial_description import TrialDescription
from .values.aids import ImuReading, PositionReading, RangeReading
from .values.errors import InputError
from .values.readings import NaturalLengthReading, OtherReading, ResistanceReading
from .values.stamps import check_stamp


def check_resistance(reading: ResistanceReading, trial: TrialDescription) -> None:
    """Check a reading of resistance.

    Raises:
        InputError: for one of another source, another sensor or another number of values, or without a stamp.
    """
    name = "reading of resistance"
    if trial.source == "lengths":
        raise InputError(f"{name}: expected lengths, which the trial has in place of resistances")
    _check_number(f"{name}: source", reading.source, range(max(len(trial.tendons_of_board), 1)))
    check_stamp(f"{name}: t_s", reading.t_s)
    check_stamp(f"{name}: arrival_s", reading.arrival_s)
    sensors = len(trial.structure.tendons) + trial.reference_strips
    numbers = np.asarray(reading.tendon)
    if numbers.ndim != 1 or not (np.isin(numbers, np.arange(sensors)).all() and len(set(numbers)) == len(numbers)):
        raise InputError(f"{name}: tendon: expected different ones from 0 to {sensors - 1}, got {reading.tendon!r:.60}")
    for key in ("resistance_ohm", "sigma_ohm", "flags"):
        if np.shape(getattr(reading, key)) != numbers.shape:
            raise InputError(f"{name}: {key}: expected {len(numbers)}, got shape {np.shape(getattr(reading, key))}")


def check_other(reading: OtherReading, trial: TrialDescription) -> None:
    """Check a reading of what is no sensor of a tendon.

    Raises:
        InputError: for one of another sensor, motor, beacon or node, of another number of values, or without a stamp.
    """
    nodes = range(trial.structure.node_count)
    match reading:
        case ImuReading():
            name = f"imu {reading.imu}"
            _check_number("imu", reading.imu, range(len(trial.imus)))
            _check_vector(f"{name}: rate_rad_per_s", reading.rate_rad_per_s)
            _check_vector(f"{name}: specific_force_m_per_s2", reading.specific_force_m_per_s2)
        case RangeReading():
            recording, beacon, node = reading.pair
            name = f"range {recording}"
            _check_number("range", recording, range(len(trial.beacon_position_m)))
            _check_number(f"{name}: beacon", beacon, range(len(trial.beacon_position_m[recording])))
            _check_number(f"{name}: node", node, nodes)
        case PositionReading():
            name = f"position {reading.recording}"
            _check_number("position", reading.recording, (*trial.world_positions, *trial.own_frames))
            _check_number(f"{name}: node", reading.node, nodes)
            _check_vector(f"{name}: position_m", reading.position_m)
        case NaturalLengthReading():
            name = f"natural length of tendon {reading.tendon}"
            wound = {tendon for motors in trial.motors for tendon in motors.tendons}
            _check_number("natural length: tendon", reading.tendon, wound)
    check_stamp(f"{name}: t_s", reading.t_s)


def _check_number(name: str, number: int, known: Collection[int]) -> None:
    if not isinstance(number, Integral) or number not in known:
        expected = f"one of {', '.join(map(str, sorted(known)))}" if known else "none, as trial.toml names none"
        raise InputError(f"{name}: expected {expected}, got {number!r:.60}")


def _check_vector(name: str, vector: NDArray[np.float64]) -> None:
    if np.shape(vector) != (3,):
        raise InputError(f"{name}: expected x, y, z, got shape {np.shape(vector)}")
