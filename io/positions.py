"""Node positions over time as CSV, `t_s, n0_x_m .. n11_z_m`, as in shape.csv and in truth.csv; forces likewise."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..models.evaluation.truth import TrueLoads
from ..models.values.errors import InputError
from ..models.values.tracks import StampedPositions
from .csv import CsvFile


def position_columns(node_count: int) -> list[str]:
    """Return the names of the columns after t_s."""
    return [f"n{node}_{axis}_m" for node in range(node_count) for axis in "xyz"]


def force_columns(node_count: int) -> list[str]:
    """Return the names of the columns after t_s of a file of forces at nodes."""
    return [f"n{node}_f{axis}_n" for node in range(node_count) for axis in "xyz"]


def contact_columns(node_count: int) -> list[str]:
    """Return the names of the columns after t_s of a file of contacts."""
    return [f"c{node}" for node in range(node_count)]


def read_contacts(path: Path, node_count: int, fewest: int = 2) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (times,) stamps and (times, nodes) probabilities that the floor carries each node.

    Args:
        path: of the file.
        node_count: of the structure.
        fewest: see `read_positions`.

    Raises:
        InputError: see `read_positions`; and for what is no probability.
    """
    columns = contact_columns(node_count)
    rows = np.array(list(CsvFile(path, ["t_s", *columns])))
    _check_count(path, len(rows), fewest)
    if (rows[:, 1:] < 0).any() or (rows[:, 1:] > 1).any():
        raise InputError(f"{path}: expected probabilities from 0 to 1 in {columns[0]} to {columns[-1]}")
    return rows[:, 0], rows[:, 1:]


def read_positions(path: Path, node_count: int, fewest: int = 2) -> StampedPositions:
    """Return the positions in a file; nan where a cell is blank or a node has no columns.

    Args:
        path: of the file.
        node_count: of the structure.
        fewest: number of rows that it has at least: 2 between which one can interpolate, 1 in a result.

    Raises:
        InputError: for a file that cannot be read, fewer rows, no node at all, or a stamp that is not later than the
            one before.
    """
    rows = _read_rows(path, position_columns(node_count), fewest)
    return StampedPositions(rows[:, 0], _vectors(rows))


def read_forces(path: Path, node_count: int) -> TrueLoads:
    """Return the forces at nodes in a file; nan as in `read_positions`.

    Raises:
        InputError: see `read_positions`.
    """
    rows = _read_rows(path, force_columns(node_count))
    return TrueLoads(rows[:, 0], _vectors(rows))


def _read_rows(path: Path, columns: list[str], fewest: int = 2) -> NDArray[np.float64]:
    """Return (times, 1 + columns): the stamps, then the columns."""
    file = CsvFile(path, ["t_s"], optional=columns, blank=columns)
    head = file.head()
    if not set(columns) & set(head.columns):
        commas = ", with commas between" if len(head.columns) == 1 else ""
        raise InputError(f"{path}: holds no node: expected columns as {columns[0]}{commas}")
    rows = np.array(list(file))
    _check_count(path, len(rows), fewest)
    for index in np.flatnonzero(np.diff(rows[:, 0]) <= 0)[:1]:
        row = index + 1 + head.first_row
        raise InputError(
            f"{path}: row {row}, column t_s: expected more than {rows[index, 0]}, got {rows[index + 1, 0]}"
        )
    return rows


def _check_count(path: Path, rows: int, fewest: int) -> None:
    """Raise InputError for a file with too few rows."""
    if rows < fewest:
        raise InputError(f"{path}: expected at least {'two rows' if fewest == 2 else 'one row'}, got {rows}")


def _vectors(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (times, nodes, 3) of (times, 1 + 3 nodes)."""
    return rows[:, 1:].reshape(len(rows), -1, 3)
