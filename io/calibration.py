"""Calibration recordings: a folder of CSV files, each of one sensor on a test rig."""

from pathlib import Path

import numpy as np

from ..models.errors import InputError
from ..models.gauge import Recording
from .csv import CsvFile


def read_recordings(folder: Path) -> list[Recording]:
    """Return all recordings of a folder, sorted by name.

    Raises:
        InputError: when there is none, or one can not be read.
    """
    paths = sorted(folder.glob("*.csv"))
    if not paths:
        raise InputError(f"{folder}: holds no recordings: expected files *.csv")
    return [read_recording(path) for path in paths]


def read_recording(path: Path) -> Recording:
    """Return one recording: `# natural_resistance_ohm = ...`, then t_s, strain, resistance_ohm.

    Raises:
        InputError: when the file is not of that form, or its stamps do not increase.
    """
    file = CsvFile(path, ["t_s", "strain", "resistance_ohm"])
    pairs, _ = file.head()
    try:
        natural_ohm = float(pairs["natural_resistance_ohm"])
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: row 1: expected '# natural_resistance_ohm = NUMBER'") from error
    rows = np.array(list(file))
    if len(rows) < 2:
        raise InputError(f"{path}: expected at least two rows, got {len(rows)}")
    for row in np.flatnonzero(np.diff(rows[:, 0]) <= 0):
        raise InputError(f"{path}: row {row + 4}, column t_s: expected a later stamp than {rows[row, 0]}")
    return Recording(path.stem, rows[:, 0], rows[:, 1], rows[:, 2] / natural_ohm - 1)
