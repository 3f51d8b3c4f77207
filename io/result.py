"""Results on disk: a directory of CSV files that is written completely or not at all."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import tomli_w
import tomlkit
from numpy.typing import NDArray

from ..models.balance.observable_loads import observable_loads
from ..models.evaluation.estimate import Estimate
from ..models.settings import Settings
from ..models.structure.external_loads import ExternalLoads
from ..models.structure.floor import EstimatedNormal
from ..models.structure.quantities import UPPER_TRIANGLE
from ..models.structure.reconstruction import Reconstruction, coordinate_frame_of
from ..models.structure.structure import Structure
from ..models.values.errors import InputError
from ..models.values.readings import Flag, Mode
from ..models.values.tables import parse_table
from ..models.values.time_series import parts
from .csv import CsvFile
from .positions import contact_columns, position_columns, read_contacts, read_positions
from .toml import read_toml
from .whole import check_replaceable, written_whole

RUN_FILE = "run.toml"
SHAPE_FILE = "shape.csv"
"""A table that every result has, and nothing else that we write."""
LOADS_FILE = "estimated_loads.csv"
RUN_TABLES = ("structure", "settings", "inputs", "versions", "floor_normal")
"""The tables of run.toml that are read again."""
DRIFT_FILE = "sensor_drift.csv"
CONTACTS_FILE = "contacts.csv"
TRACK_FILE = "track.csv"
SLIPS_FILE = "slips.csv"
COVARIANCE_COLUMNS = tuple(filter(None, UPPER_TRIANGLE))
"""The upper triangle, row by row; ten digits, because the inverse for a long, thin ellipsoid loses seven."""
ROUNDED = 1e-6
"""Negative variance over the greatest one that rounding of a file may make."""

BLOCK_ROWS = 10_000
"""Rows of a table that are made at a time, so that a long run does not need much memory for them."""


@contextmanager
def result_directory(path: Path, marker: str = SHAPE_FILE) -> Iterator[Path]:
    """Give a temporary directory to write into; it is moved to `path` if the block succeeds.

    Args:
        path: of the directory.
        marker: name of a file that every earlier result of the same kind contains; such a result is replaced.

    Raises:
        InputError: when anything but an earlier result exists at `path`, or it cannot be written.
    """
    check_replaceable(path, marker)
    with written_whole(path) as (inside,):
        inside.mkdir()
        yield inside


def write_tables(reconstruction: Reconstruction, probability: float, directory: Path) -> None:
    """Write shape, ellipsoids, lengths and status, and loads and other shapes if there are any.

    Rows are appended to tables that exist already, because a live run is written in parts.
    """
    _append(directory / SHAPE_FILE, _shape_rows(reconstruction))
    _append(directory / "ellipsoids.csv", _ellipsoid_rows(reconstruction, probability))
    _append(directory / "lengths.csv", _length_rows(reconstruction))
    _append(directory / "status.csv", _status_rows(reconstruction))
    if any(reconstruction.others):
        _append(directory / "other_shape.csv", _other_rows(reconstruction))
    if reconstruction.drift is not None and reconstruction.drift_sigma is not None:
        _append(
            directory / DRIFT_FILE, _drift_rows(reconstruction.t_s, reconstruction.drift, reconstruction.drift_sigma)
        )
    if reconstruction.contacts is not None:
        _append(directory / CONTACTS_FILE, _contact_rows(reconstruction.t_s, reconstruction.contacts))
        _append(directory / TRACK_FILE, _track_rows(reconstruction))
        _append(directory / SLIPS_FILE, _slip_rows(reconstruction))
    if reconstruction.loads:
        _append(directory / LOADS_FILE, _load_rows(reconstruction, reconstruction.loads))


def write_latencies(columns: Sequence[str], seconds: NDArray[np.float64], directory: Path) -> None:
    """Append the latencies of live shapes, (frames, columns), to their table."""
    rows = _rows(",".join(["%.6f"] * len(columns)), seconds)
    _append(directory / "latency.csv", chain([",".join(columns)], rows))


def write_run(run: Mapping[str, Any], structure: Structure, directory: Path) -> None:
    """Write run.toml, whose last table is the structure, as in trial.toml."""
    names = ("rods", "tendons", "rod_length_m", "natural_length_m", "anchors", "anchor_position_m")
    table = {"structure": {name: getattr(structure, name).tolist() for name in names}}
    if len(structure.unsensed):
        table["structure"]["unsensed"] = structure.unsensed.tolist()
    text = f"{tomli_w.dumps(run)}\n{tomlkit.item(table).as_string()}"
    (directory / RUN_FILE).write_text(text, encoding="utf-8")


def floor_table(normal: EstimatedNormal | None) -> dict[str, Any]:
    """Return the table `[floor_normal]` of run.toml; nothing where the normal is told exactly, or there is no floor."""
    return {} if normal is None else {"floor_normal": asdict(normal)}


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
    return run


def settings_of(run: Mapping[str, Any], directory: Path) -> Settings:
    """Return the settings in the run.toml of a result directory, see `read_run`.

    Raises:
        InputError: for a value that is not allowed.
    """
    return parse_table(Settings, run.get("settings", {}), str(directory / RUN_FILE))


def read_estimate(directory: Path, structure: Structure) -> Estimate:
    """Return the shapes, covariances, lengths and, where there are any, loads of a result directory.

    Raises:
        InputError: when a table cannot be read, or does not match shape.csv or the structure.
    """
    positions = read_positions(directory / SHAPE_FILE, structure.node_count, fewest=1)
    t_s = positions.t_s
    if np.isnan(positions.node_position_m).any():
        raise InputError(f"{directory / SHAPE_FILE}: expected the positions of all {structure.node_count} nodes")
    nodes = np.arange(structure.node_count)
    tendons = np.arange(len(structure.tendons))
    middle = ["x_m", "y_m", "z_m"]
    ellipsoid = read_blocks(directory / "ellipsoids.csv", "node", nodes, t_s, [*middle, *COVARIANCE_COLUMNS])
    if not np.array_equal(ellipsoid[..., :3], positions.node_position_m):
        raise InputError(
            f"{directory / 'ellipsoids.csv'}: expected the positions of shape.csv in the middle of ellipsoids"
        )
    covariance_m2 = np.empty((*ellipsoid.shape[:2], 3, 3))
    row, column = np.triu_indices(3)
    covariance_m2[..., row, column] = covariance_m2[..., column, row] = ellipsoid[..., 3:]
    _check_covariances(directory / "ellipsoids.csv", covariance_m2)
    words = {
        "length_m": number,
        "sigma_m": number,
        "innovation_sigma_m": number,
        "mode": _mode,
        "flags": Flag.of_names,
    }
    lengths = read_blocks(directory / "lengths.csv", "tendon", tendons, t_s, list(words), words)
    length_m, sigma_m, innovation_sigma_m, mode, flags = np.moveaxis(lengths, -1, 0)
    contacts = _read_contacts(directory / CONTACTS_FILE, structure, t_s)
    return Estimate(
        t_s=t_s,
        node_position_m=positions.node_position_m,
        node_covariance_m2=covariance_m2,
        length_m=length_m,
        sigma_m=sigma_m,
        mode=mode.astype(np.int64),
        flags=flags.astype(np.int64),
        innovation_sigma_m=innovation_sigma_m,
        is_sensed=structure.is_sensed,
        loads=_read_loads(directory / LOADS_FILE, structure, t_s),
        contacts=contacts,
        coordinate_frame=coordinate_frame_of(structure, has_floor=contacts is not None),
    )


def _check_covariances(path: Path, covariance_m2: NDArray[np.float64]) -> None:
    """Raise InputError for (frames, nodes, 3, 3) of which one is the covariance of nothing; nan where there is none."""
    told = np.isfinite(covariance_m2).all(axis=(-2, -1), keepdims=True)
    variance_m2 = np.linalg.eigvalsh(np.where(told, covariance_m2, 0.0))
    wrong = variance_m2[..., 0] < -ROUNDED * variance_m2[..., -1]
    for frame, node in np.argwhere(wrong)[:1]:
        raise InputError(
            f"{path}: row {2 + frame * covariance_m2.shape[1] + node}, columns {COVARIANCE_COLUMNS[0]} to "
            f"{COVARIANCE_COLUMNS[-1]}: expected a covariance, got one with the variance "
            f"{variance_m2[frame, node, 0]:.3g} m2 in some direction"
        )


def _read_contacts(path: Path, structure: Structure, t_s: NDArray[np.float64]) -> NDArray[np.float64] | None:
    if not path.is_file():
        return None
    contacts_s, probability = read_contacts(path, structure.node_count, fewest=1)
    if not np.array_equal(contacts_s, t_s):
        raise InputError(f"{path}: expected one row for each row of shape.csv")
    return probability


def _read_loads(path: Path, structure: Structure, t_s: NDArray[np.float64]) -> ExternalLoads | None:
    if not path.is_file():
        return None
    words = dict.fromkeys(("fx_n", "fy_n", "fz_n"), _force) | {"sigma_n": number}
    rows = read_blocks(path, "node", structure.free_nodes, t_s, list(words), words)
    force_n = np.full((len(t_s), structure.node_count, 3), np.nan)
    sigma_n = np.full(force_n.shape[:2], np.inf)
    force_n[:, structure.free_nodes] = rows[..., :3]
    sigma_n[:, structure.free_nodes] = rows[..., 3]
    return ExternalLoads(force_n, sigma_n)


def read_blocks(
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


def _append(path: Path, rows: Iterator[str]) -> None:
    """Append rows to a table; the first row is the header, written only if the table is new."""
    header = next(rows)
    with path.open("a", encoding="utf-8", newline="\n") as file:
        if file.tell() == 0:
            file.write(f"{header}\n")
        file.writelines(f"{row}\n" for row in rows)


def _rows(form: str, *columns: NDArray[Any]) -> Iterator[str]:
    """Yield the rows of a table as text, many rows at a time.

    Args:
        form: of a row, for the operator %.
        columns: (rows,) or (rows, columns) each, side by side.
    """
    for block in parts(len(columns[0]), BLOCK_ROWS):
        cells = np.column_stack([column[block] for column in columns])
        yield "\n".join([form] * len(cells)) % tuple(cells.ravel().tolist())


def _each(t_s: NDArray[np.float64], members: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return time and number of each row of a table that has one row for each member in each frame."""
    return np.repeat(t_s, len(members)), np.tile(members, len(t_s))


def _shape_rows(r: Reconstruction) -> Iterator[str]:
    yield ",".join(["t_s", *position_columns(r.structure.node_count)])
    yield from _rows("%.4f" + 3 * r.structure.node_count * ",%.6f", r.t_s, r.node_position_m.reshape(len(r), -1))


def _ellipsoid_rows(r: Reconstruction, probability: float) -> Iterator[str]:
    yield (f"t_s,node,x_m,y_m,z_m,{','.join(COVARIANCE_COLUMNS)},semi_a_m,semi_b_m,semi_c_m,qx,qy,qz,qw,probability")
    regions = r.ellipsoids(probability)
    row, column = np.triu_indices(3)
    yield from _rows(
        "%.4f,%d" + 3 * ",%.6f" + 6 * ",%.9e" + 7 * ",%.6f" + f",{probability:g}",
        *_each(r.t_s, np.arange(r.structure.node_count)),
        r.node_position_m.reshape(-1, 3),
        r.node_covariance_m2[..., row, column].reshape(-1, 6),
        regions.semi_axis_m.reshape(-1, 3),
        regions.quaternion.reshape(-1, 4),
    )


def _length_rows(r: Reconstruction) -> Iterator[str]:
    yield "t_s,tendon,length_m,sigma_m,mode,flags,predicted_m,innovation_sigma_m"
    modes = np.array([mode.name.lower() for mode in sorted(Mode)], dtype=object)
    flags, flags_of = np.unique(r.flags, return_inverse=True)
    names = np.array([Flag(int(flag)).names() for flag in flags], dtype=object)
    yield from _rows(
        "%.4f,%d,%.6f,%.6f,%s,%s,%.6f,%.6f",
        *_each(r.t_s, np.arange(len(r.structure.tendons))),
        r.length_m.ravel(),
        r.sigma_m.ravel(),
        modes[r.mode.ravel()],
        names[flags_of.ravel()],
        r.predicted_m.ravel(),
        r.innovation_sigma_m.ravel(),
    )


def _load_rows(r: Reconstruction, loads: ExternalLoads) -> Iterator[str]:
    yield "t_s,node,fx_n,fy_n,fz_n,sigma_n,observable"
    free = r.structure.free_nodes
    observable = np.array(observable_loads(r.structure), dtype=object)
    yield from _rows(
        "%.4f,%d" + 4 * ",%.4f" + ",%s",
        *_each(r.t_s, free),
        loads.force_n[:, free].reshape(-1, 3),
        loads.sigma_n[:, free].ravel(),
        np.tile(observable[free], len(r)),
    )


def _contact_rows(t_s: NDArray[np.float64], contacts: NDArray[np.float64]) -> Iterator[str]:
    yield ",".join(["t_s", *contact_columns(contacts.shape[1])])
    yield from _rows("%.4f" + contacts.shape[1] * ",%.3f", t_s, contacts)


def _track_rows(r: Reconstruction) -> Iterator[str]:
    yield ",".join(["t_s", "x_m", "y_m", "z_m", *COVARIANCE_COLUMNS])
    row, column = np.triu_indices(3)
    covariance = r.centroid_covariance_m2[:, row, column]
    yield from _rows("%.4f" + 3 * ",%.6f" + 6 * ",%.9e", r.t_s, r.centroid_m, covariance)


def _slip_rows(r: Reconstruction) -> Iterator[str]:
    yield "t_s,node,distance_m,sigma_m,x_m,y_m,z_m"
    for slip in (slip for frame in r.slips for slip in frame):
        numbers = ",".join(f"{value:.6f}" for value in (slip.distance_m, slip.sigma_m, *slip.way_m))
        yield f"{slip.t_s:.4f},{slip.node},{numbers}"


def _drift_rows(t_s: NDArray[np.float64], drift: NDArray[np.float64], sigma: NDArray[np.float64]) -> Iterator[str]:
    yield "t_s,tendon,drift,sigma"
    shown = np.isfinite(sigma).all(axis=1)
    columns = _each(t_s[shown], np.arange(drift.shape[1]))
    yield from _rows("%.4f,%d,%.6f,%.6f", *columns, drift[shown].ravel(), sigma[shown].ravel())


def _status_rows(r: Reconstruction) -> Iterator[str]:
    yield "t_s,status,smallest_singular_value,mechanism_sigma_m,branch,other_log_ratio,doubt"
    columns = (r.t_s, r.status, r.smallest_singular_value, r.mechanism_sigma_m, r.branch, r.others, r.doubts)
    for t_s, status, value, sigma_m, side, other, doubt in zip(*columns, strict=True):
        log_ratio = f"{other.log_ratio:.2f}" if other else "nan"
        yield f"{t_s:.4f},{status},{value:.6f},{sigma_m:.6f},{side:.0f},{log_ratio},{doubt or 'none'}"


def _other_rows(r: Reconstruction) -> Iterator[str]:
    yield ",".join(["t_s", *position_columns(r.structure.node_count)])
    for t_s, other in zip(r.t_s, r.others, strict=True):
        if other:
            yield f"{t_s:.4f}," + ",".join(f"{value:.6f}" for value in other.node_position_m.ravel())
