"""Readings that a program tells: those that are of no sensor of the trial are refused in one line."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import InputError, ResistanceReading, open_trial, stream
from tensegraph.models.values.aids import ImuReading, PositionReading, RangeReading
from tensegraph.models.values.readings import BoardReading, NaturalLengthReading
from told_rows import rows_of

NAN = float("nan")
THREE = np.zeros(3)


def resistance(source: int = 0, t_s: float = 0.0, tendons: int = 24, **changed) -> ResistanceReading:
    """A reading of all sensors at 5.5 MOhm."""
    values = np.full(24, 5.5e6)
    reading = ResistanceReading(source, t_s, t_s, np.arange(tendons), values, 0 * values, np.zeros(24, dtype=np.int64))
    return replace(reading, **changed)


@pytest.mark.parametrize(
    ("reading", "message"),
    [
        (resistance(source=5), "reading of resistance: source: expected one of 0, 1, got 5"),
        (resistance(tendons=3), r"reading of resistance: resistance_ohm: expected 3, got shape \(24,\)"),
        (resistance(tendon=np.arange(7, 31)), "reading of resistance: tendon: expected different ones from 0 to 23"),
        (resistance(tendon=np.full(24, 3)), "reading of resistance: tendon: expected different ones from 0 to 23"),
        (resistance(t_s=NAN), "reading of resistance: t_s: expected a stamp of at most .* got nan"),
        (resistance(arrival_s=NAN), "reading of resistance: arrival_s: expected a stamp"),
        (ImuReading(0, 0.0, THREE, THREE), "imu: expected none, as trial.toml names none, got 0"),
        (RangeReading(0.0, THREE, (0, 0, 4), 1.0), "range: expected none"),
        (PositionReading(0.0, 4, THREE), "position: expected none"),
        (NaturalLengthReading(0.0, 3, 0.17, 0.0), "natural length: tendon: expected none"),
        (rows_of(np.full((1, 24), 0.17))[0].flags, "readings: expected those of"),
        (BoardReading(0, 0.0, 0, 0, [512] * 12), "board 0: expected counts as an array of integers, got list"),
        (BoardReading(0, 0.0, 0, 0, np.full(12, 512.0)), "expected counts as an array of integers, got float64"),
    ],
)
def test_what_is_of_no_sensor_is_refused(example, reading, message) -> None:
    with pytest.raises(InputError, match=message):
        list(stream([reading], open_trial(example).description))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"flags": np.zeros(24)}, r"expected 24 flags, integers, got float64 of shape \(24,\)"),
        ({"mode": np.zeros(3, dtype=np.int64)}, r"expected 24 modes, integers, got int64 of shape \(3,\)"),
        ({"mode": 0}, "expected 24 modes, integers, got int"),
    ],
)
def test_lengths_have_a_mode_and_flags_each(example, changed, message) -> None:
    (lengths,) = rows_of(np.full((1, 24), 0.17))
    with pytest.raises(InputError, match=f"lengths at 0 s: {message}"):
        list(stream([replace(lengths, **changed)], open_trial(example).description))


def test_a_trial_of_lengths_has_neither_boards_nor_resistances(example) -> None:
    told = replace(open_trial(example).description, source="lengths", tendons_of_board=(), divider=None)
    row = BoardReading(0, 0.0, 0, 0, np.zeros(12, dtype=np.int64))
    for reading, message in ((row, "row of board 0: the trial has lengths"), (resistance(), "expected lengths")):
        with pytest.raises(InputError, match=message):
            list(stream([reading], told))
