"""Stamped node positions as CSV: `t_s, n0_x_m .. n11_z_m`, the form of shape.csv and of truth; forces likewise."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..models.values.errors import InputError
from .csv import CsvFile


def position_columns(node_count: int) -> list[str]:
    """Return the names of the columns after t_s."""
    return [f"n{node}_{axis}_m" for node in range(node_count) for axis in "xyz"]


def force_columns(node_count: int) -> list[str]:
    """Return the names of the columns after t_s of a file of forces at nodes."""
    return [f"n{node}_f{axis}_n" for node in range(node_count) for axis in "xyz"]


def read_positions(path: Path, node_count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (times,) t_s and (times, nodes, 3) positions; nan where a cell is blank or a node has no columns.

    Raises:
        InputError: for a file that can not be read, fewer than two rows, no node at all, or a stamp that does not
            go on from the one before.
    """
    return _read_vectors(path, position_columns(node_count))


def read_forces(path: Path, node_count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (times,) t_s and (times, nodes, 3) forces; see `read_positions`."""
    return _read_vectors(path, force_columns(node_count))


def _read_vectors(path: Path, columns: list[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    file = CsvFile(path, ["t_s"], optional=columns, blank=columns)
    if not set(columns) & set(file.head()[1]):
        raise InputError(f"{path}: holds no node: expected columns as {columns[0]}")
    rows = np.array(list(file))
    if len(rows) < 2:
        raise InputError(f"{path}: expected at least two rows, got {len(rows)}")
    for index in np.flatnonzero(np.diff(rows[:, 0]) <= 0)[:1]:
        row = index + 3 + len(file.head()[0])
        raise InputError(
            f"{path}: row {row}, column t_s: expected more than {rows[index, 0]}, got {rows[index + 1, 0]}"
        )
    return rows[:, 0], rows[:, 1:].reshape(len(rows), -1, 3)
