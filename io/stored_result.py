"""Result directories, read back."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..models.settings import Settings
from ..models.structure.external_loads import ExternalLoads
from ..models.structure.floor import EstimatedNormal
from ..models.structure.reconstruction import Propagated, Reconstruction
from ..models.structure.shape import Covariances, OtherShape, Reason, Status
from ..models.structure.structure import Structure
from ..models.structure_description import StructureTable
from ..models.values.errors import InputError
from ..models.values.readings import Flag, Mode
from ..models.values.slip import Slip
from ..models.values.tables import parse_table
from ..models.values.tracks import StampedPositions
from .csv import CsvFile
from .positions import position_columns, read_contacts, read_positions
from .result import (
    CONTACTS_FILE,
    COVARIANCE_CELLS,
    COVARIANCE_COLUMNS,
    DRIFT_FILE,
    LOADS_FILE,
    RUN_FILE,
    SHAPE_FILE,
    SLIPS_FILE,
    TRACK_FILE,
)
from .toml import read_toml

OPTIONAL_FILES = (LOADS_FILE, DRIFT_FILE, CONTACTS_FILE, TRACK_FILE, SLIPS_FILE)
"""The tables of which a result need not have all."""
RUN_TABLES = ("structure", "settings", "inputs", "versions", "floor_normal")
"""The tables of run.toml that are read."""
ROUNDED = 1e-6
"""Negative variance over the greatest one that rounding of a file may make."""


def load(path: str | Path) -> Reconstruction:
    """Return the run in a result directory, to the digits that its tables have.

    Of covariances the tables hold those of each node alone: between nodes `covariance_m2` is nan, and what follows from
    it is read (`innovation_sigma_m`, `mechanism_sigma_m`, the covariance of the centroid).

    Args:
        path: result directory, written by `save`, `reconstruct` or `live`.

    Raises:
        InputError: when it is no result, or a table cannot be read.
    """
    path = Path(path)
    run = read_run(path)
    structure = _structure(path, run)
    for name in OPTIONAL_FILES:
        if name in run.get("tables", []) and not (path / name).is_file():
            raise InputError(f"{path / name}: is missing: {RUN_FILE} names it")
    positions = read_positions(path / SHAPE_FILE, structure.node_count, fewest=1)
    t_s = positions.t_s
    if np.isnan(positions.node_position_m).any():
        raise InputError(f"{path / SHAPE_FILE}: expected the positions of all {structure.node_count} nodes")
    words: dict[str, Callable[[str], float]]
    words = dict.fromkeys(("length_m", "sigma_m", "innovation_sigma_m"), _not_negative)
    words |= {"mode": _mode, "flags": Flag.of_names}
    tendons = np.arange(len(structure.tendons))
    lengths = _read_blocks(path / "lengths.csv", "tendon", tendons, t_s, list(words), words)
    length_m, sigma_m, innovation_sigma_m, mode, flags = np.moveaxis(lengths, -1, 0)
    frames = _FramesTable(path, t_s)
    drift, drift_sigma = _drift(path / DRIFT_FILE, t_s, len(tendons))
    return Reconstruction(
        structure=structure,
        t_s=t_s,
        node_position_m=positions.node_position_m,
        covariances=_covariances(path / "ellipsoids.csv", positions),
        status=frames.status,
        length_m=length_m,
        sigma_m=sigma_m,
        mode=mode.astype(np.int64),
        flags=flags.astype(np.int64),
        loads=_loads(path / LOADS_FILE, structure, t_s),
        others=frames.others(structure.node_count),
        doubts=frames.doubts,
        drift=drift,
        drift_sigma=drift_sigma,
        contacts=_contacts(path / CONTACTS_FILE, structure, t_s),
        slips=_slips(path / SLIPS_FILE, t_s, structure.node_count),
        floor_normal=_floor_normal(path, run),
        propagated=Propagated(innovation_sigma_m, frames.mechanism_sigma_m, _centroid_covariance_m2(path, t_s)),
    )


def read_run(directory: Path) -> dict[str, Any]:
    """Return run.toml of a result directory.

    Raises:
        InputError: when there is none, or something else stands in the place of one of its tables.
    """
    path = directory / RUN_FILE
    if not path.is_file():
        raise InputError(f"{directory}: is no result: expected a directory with {RUN_FILE}")
    run = read_toml(path)
    for name in RUN_TABLES:
        if not isinstance(run.get(name, {}), dict):
            raise InputError(f"{path}: {name}: expected a table, got {run[name]!r:.60}")
    if not isinstance(run.get("tables", []), list):
        raise InputError(f"{path}: tables: expected names of files, got {run['tables']!r:.60}")
    return run


def settings_of(run: Mapping[str, Any], directory: Path) -> Settings:
    """Return the settings in the run.toml of a result directory, see `read_run`.

    Raises:
        InputError: for a value that is not allowed.
    """
    return parse_table(Settings, run.get("settings", {}), str(directory / RUN_FILE))


def _structure(path: Path, run: dict[str, Any]) -> Structure:
    if "structure" not in run:
        raise InputError(f"{path / RUN_FILE}: structure: is missing: is the file cut off?")
    try:
        return parse_table(StructureTable, run["structure"], "structure").structure()
    except InputError as error:
        raise InputError(f"{path / RUN_FILE}: {error}") from error


def _floor_normal(path: Path, run: dict[str, Any]) -> EstimatedNormal | None:
    if "floor_normal" not in run:
        return None
    return parse_table(EstimatedNormal, run["floor_normal"], f"{path / RUN_FILE}: floor_normal")


class _FramesTable:
    """status.csv, and the other shapes that it has frames of."""

    def __init__(self, directory: Path, t_s: NDArray[np.float64]) -> None:
        self._directory = directory
        self._t_s = t_s
        path = directory / "status.csv"
        words = {"status": _status, "doubt": _doubt, "mechanism_sigma_m": _not_negative, "other_log_ratio": number}
        rows = np.array(list(CsvFile(path, ["t_s", *words], words=words))).reshape(-1, 1 + len(words))
        if not np.array_equal(rows[:, 0], t_s):
            raise InputError(f"{path}: expected one row for each row of shape.csv")
        self.status = tuple(_STATUSES[int(code)] for code in rows[:, 1])
        self.doubts = tuple(_REASONS[int(code)] for code in rows[:, 2])
        self.mechanism_sigma_m = rows[:, 3]
        self._log_ratio = rows[:, 4]

    def others(self, node_count: int) -> tuple[OtherShape | None, ...]:
        """Return the second shape of each frame."""
        path = self._directory / "other_shape.csv"
        stated = np.flatnonzero(np.isfinite(self._log_ratio))
        rows = np.empty((0, 1 + 3 * node_count))
        if path.is_file():
            rows = np.array(list(CsvFile(path, ["t_s", *position_columns(node_count)]))).reshape(-1, rows.shape[1])
        if not np.array_equal(rows[:, 0], self._t_s[stated]):
            raise InputError(f"{path}: expected one row for each frame of status.csv with other_log_ratio")
        found: list[OtherShape | None] = [None] * len(self._t_s)
        for k, row in zip(stated, rows, strict=True):
            found[k] = OtherShape(row[1:].reshape(-1, 3), float(self._log_ratio[k]))
        return tuple(found)


_STATUSES = tuple(Status)
_REASONS = (None, *Reason)


def _status(cell: str) -> float:
    try:
        return float(_STATUSES.index(Status(cell.strip())))
    except ValueError as error:
        raise ValueError(f"expected one of {', '.join(_STATUSES)}") from error


def _doubt(cell: str) -> float:
    try:
        return 0.0 if cell.strip() == "none" else float(_REASONS.index(Reason(cell.strip())))
    except ValueError as error:
        raise ValueError(f"expected one of none, {', '.join(Reason)}") from error


def _centroid_covariance_m2(path: Path, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (frames, 3, 3) of track.csv; nan where there is none."""
    track = path / TRACK_FILE
    if not track.is_file():
        return np.full((len(t_s), 3, 3), np.nan)
    rows = np.array(list(CsvFile(track, ["t_s", *COVARIANCE_COLUMNS]))).reshape(-1, 1 + len(COVARIANCE_COLUMNS))
    if not np.array_equal(rows[:, 0], t_s):
        raise InputError(f"{track}: expected one row for each row of shape.csv")
    return _checked_covariances(track, rows[:, None, 1:])[:, 0]


def _slips(path: Path, t_s: NDArray[np.float64], node_count: int) -> tuple[tuple[Slip, ...], ...]:
    """Return (frames,) the slips that were found in each frame; empty where there is no floor."""
    if not path.is_file():
        return ()
    slips: list[list[Slip]] = [[] for _ in t_s]
    frame_at = {time_s: frame for frame, time_s in enumerate(t_s.tolist())}
    for slip_s, node, sigma_m, *way_m in CsvFile(path, ["t_s", "node", "sigma_m", "x_m", "y_m", "z_m"]):
        if slip_s not in frame_at or node not in range(node_count):
            got = f"node {node:g} at {slip_s:g} s"
            raise InputError(f"{path}: expected nodes from 0 to {node_count - 1} at times of shape.csv, got {got}")
        slips[frame_at[slip_s]].append(Slip(slip_s, int(node), np.array(way_m), sigma_m))
    return tuple(map(tuple, slips))


def _drift(
    path: Path, t_s: NDArray[np.float64], tendons: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | tuple[None, None]:
    """Return (frames, tendons) drift and its sigma; nan in frames of a live run whose drift was not known yet."""
    if not path.is_file():
        return None, None
    drift_s = np.unique([row[0] for row in CsvFile(path, ["t_s"])])
    known = np.isin(t_s, drift_s)
    drift = np.full((2, len(t_s), tendons), np.nan)
    drift[:, known] = np.moveaxis(
        _read_blocks(path, "tendon", np.arange(tendons), t_s[known], ("drift", "sigma"), {"sigma": _not_negative}),
        2,
        0,
    )
    return drift[0], drift[1]


def _covariances(path: Path, positions: StampedPositions) -> Covariances:
    """Return the covariances of ellipsoids.csv, whose middles are the positions of shape.csv."""
    middle = ["x_m", "y_m", "z_m"]
    nodes = np.arange(positions.node_position_m.shape[1])
    ellipsoid = _read_blocks(path, "node", nodes, positions.t_s, [*middle, *COVARIANCE_COLUMNS])
    if not np.array_equal(ellipsoid[..., :3], positions.node_position_m):
        raise InputError(f"{path}: expected the positions of shape.csv in the middle of ellipsoids")
    return Covariances.of_nodes(_checked_covariances(path, ellipsoid[..., 3:]))


def _checked_covariances(path: Path, cells: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (frames, rows of each, 3, 3) from (frames, rows of each, 6); nan for none.

    Raises:
        InputError: when one is a covariance of nothing.
    """
    covariance_m2 = np.empty((*cells.shape[:2], 3, 3))
    covariance_m2[..., *COVARIANCE_CELLS] = covariance_m2[..., *COVARIANCE_CELLS[::-1]] = cells
    told = np.isfinite(covariance_m2).all(axis=(-2, -1), keepdims=True)
    variance_m2 = np.linalg.eigvalsh(np.where(told, covariance_m2, 0.0))
    wrong = variance_m2[..., 0] < -ROUNDED * variance_m2[..., -1]
    for frame, row in np.argwhere(wrong)[:1]:
        raise InputError(
            f"{path}: row {2 + frame * covariance_m2.shape[1] + row}, columns {COVARIANCE_COLUMNS[0]} to "
            f"{COVARIANCE_COLUMNS[-1]}: expected a covariance, got one with the variance "
            f"{variance_m2[frame, row, 0]:.3g} m2 in some direction"
        )
    return covariance_m2


def _contacts(path: Path, structure: Structure, t_s: NDArray[np.float64]) -> NDArray[np.float64] | None:
    if not path.is_file():
        return None
    contacts_s, probability = read_contacts(path, structure.node_count, fewest=1)
    if not np.array_equal(contacts_s, t_s):
        raise InputError(f"{path}: expected one row for each row of shape.csv")
    return probability


def _loads(path: Path, structure: Structure, t_s: NDArray[np.float64]) -> ExternalLoads | None:
    if not path.is_file():
        return None
    words = dict.fromkeys(("fx_n", "fy_n", "fz_n"), _force) | {"sigma_n": _not_negative}
    rows = _read_blocks(path, "node", structure.free_nodes, t_s, list(words), words)
    force_n = np.full((len(t_s), structure.node_count, 3), np.nan)
    sigma_n = np.full(force_n.shape[:2], np.inf)
    force_n[:, structure.free_nodes] = rows[..., :3]
    sigma_n[:, structure.free_nodes] = rows[..., 3]
    return ExternalLoads(force_n, sigma_n)


def _read_blocks(
    path: Path,
    label: str,
    labels: NDArray[np.int64],
    t_s: NDArray[np.float64],
    columns: Sequence[str],
    words: Mapping[str, Callable[[str], float]] = MappingProxyType({}),
) -> NDArray[np.float64]:
    """Return (frames, labels, columns) of a table that has a row for each frame and each label, in order.

    Raises:
        InputError: when a row is missing, or a cell is no number and no word.
    """
    names = ["t_s", label, *columns]
    rows = np.array(list(CsvFile(path, names, words=words))).reshape(-1, len(names))
    expected = np.stack([np.repeat(t_s, len(labels)), np.tile(labels, len(t_s))], axis=1)
    if not np.array_equal(rows[:, :2], expected):
        which = f"{len(labels)} rows ({label} {labels[0]} to {labels[-1]})"
        raise InputError(f"{path}: expected {which} for each row of shape.csv")
    return rows[:, 2:].reshape(len(t_s), len(labels), len(columns))


def number(cell: str) -> float:
    """Return a number that may be nan or inf.

    Raises:
        ValueError: when it is none.
    """
    try:
        return float(cell)
    except ValueError as error:
        raise ValueError("expected a number, nan or inf") from error


def _not_negative(cell: str) -> float:
    value = number(cell)
    if value < 0:
        raise ValueError("expected a number that is not negative, nan or inf")
    return value


def _force(cell: str) -> float:
    value = number(cell)
    if np.isinf(value):
        raise ValueError("expected a finite number or nan")
    return value


def _mode(cell: str) -> float:
    try:
        return float(Mode[cell.upper()])
    except KeyError as error:
        raise ValueError(f"expected {' or '.join(mode.name.lower() for mode in Mode)}") from error
