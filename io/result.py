"""Results on disk: a directory of CSV files that is there whole or not at all."""

import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..models.evaluation.estimate import Estimate
from ..models.structure.external_loads import ExternalLoads, observable_loads
from ..models.structure.reconstruction import Reconstruction
from ..models.structure.structure import Structure
from ..models.values.errors import InputError
from ..models.values.readings import Flag, Mode
from .csv import CsvFile
from .positions import position_columns, read_positions
from .toml import read_toml

RUN_FILE = "run.toml"
LOADS_FILE = "estimated_loads.csv"
COVARIANCE_COLUMNS = ("cxx_m2", "cxy_m2", "cxz_m2", "cyy_m2", "cyz_m2", "czz_m2")
"""The upper triangle, row by row; ten digits, since the inverse of a long, thin ellipsoid takes seven away."""


@contextmanager
def result_directory(path: Path, marker: str = RUN_FILE) -> Iterator[Path]:
    """Give a directory to write into; it takes the name `path` when the block ends without an error.

    Args:
        path: of the directory.
        marker: the file by which an earlier one of the same kind is known, and may be replaced.

    Raises:
        InputError: when something else than an earlier result stands at `path`, or it can not be written.
    """
    check_result_path(path, marker)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
    except OSError as error:
        raise InputError(f"{path}: can not be written: {error}") from error
    try:
        yield temporary
        temporary.chmod(0o755)
        if path.exists():
            shutil.rmtree(path)
        temporary.rename(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_result_path(path: Path, marker: str = RUN_FILE) -> None:
    """Refuse to replace anything but an earlier result.

    Raises:
        InputError: when `path` is something else.
    """
    if path.exists() and not (path.is_dir() and ((path / marker).is_file() or not any(path.iterdir()))):
        raise InputError(f"{path}: exists and is no earlier result: expected a new name, or a directory with {marker}")


def write_tables(reconstruction: Reconstruction, probability: float, directory: Path) -> None:
    """Write shape, ellipsoids, lengths, status; estimated_loads, other_shape and sensor_drift where there are such.

    Tables that are there already are gone on with: a live run comes in parts.
    """
    _append(directory / "shape.csv", _shape_rows(reconstruction))
    _append(directory / "ellipsoids.csv", _ellipsoid_rows(reconstruction, probability))
    _append(directory / "lengths.csv", _length_rows(reconstruction))
    _append(directory / "status.csv", _status_rows(reconstruction))
    if any(reconstruction.others):
        _append(directory / "other_shape.csv", _other_rows(reconstruction))
    if reconstruction.drift is not None and reconstruction.drift_sigma is not None:
        rows = _drift_rows(reconstruction.t_s, reconstruction.drift, reconstruction.drift_sigma)
        _append(directory / "sensor_drift.csv", rows)
    if reconstruction.loads:
        _append(directory / LOADS_FILE, _load_rows(reconstruction, reconstruction.loads))


def write_run(run: Mapping[str, Any], directory: Path) -> None:
    """Write run.toml."""
    (directory / RUN_FILE).write_text(tomli_w.dumps(run), encoding="utf-8")


def read_run(directory: Path) -> dict[str, Any]:
    """Return run.toml of a result directory.

    Raises:
        InputError: when there is none.
    """
    if not (directory / RUN_FILE).is_file():
        raise InputError(f"{directory}: is no result: expected a directory with {RUN_FILE}")
    return read_toml(directory / RUN_FILE)


def read_estimate(directory: Path, structure: Structure) -> Estimate:
    """Return the shapes, covariances, lengths and, where there are any, loads of a result directory.

    Raises:
        InputError: when a table can not be read, or does not go with shape.csv or the structure.
    """
    t_s, position_m = read_positions(directory / "shape.csv", structure.node_count)
    if np.isnan(position_m).any():
        raise InputError(f"{directory / 'shape.csv'}: expected the positions of all {structure.node_count} nodes")
    nodes, tendons = np.arange(structure.node_count), np.arange(len(structure.tendons))
    ellipsoid = _read_blocks(directory / "ellipsoids.csv", "node", nodes, t_s, COVARIANCE_COLUMNS)
    covariance_m2 = np.empty((*ellipsoid.shape[:2], 3, 3))
    row, column = np.triu_indices(3)
    covariance_m2[..., row, column] = covariance_m2[..., column, row] = ellipsoid
    words = {
        "length_m": _number,
        "sigma_m": _number,
        "innovation_sigma_m": _number,
        "mode": _mode,
        "flags": Flag.of_names,
    }
    lengths = _read_blocks(directory / "lengths.csv", "tendon", tendons, t_s, list(words), words)
    length_m, sigma_m, innovation_sigma_m, mode, flags = np.moveaxis(lengths, -1, 0)
    return Estimate(
        t_s,
        position_m,
        covariance_m2,
        length_m,
        sigma_m,
        mode.astype(np.int64),
        flags.astype(np.int64),
        innovation_sigma_m,
        _read_loads(directory / LOADS_FILE, structure, t_s),
    )


def _read_loads(path: Path, structure: Structure, t_s: NDArray[np.float64]) -> ExternalLoads | None:
    if not path.is_file():
        return None
    rows = _read_blocks(path, "node", structure.free_nodes, t_s, ("fx_n", "fy_n", "fz_n", "sigma_n"))
    force_n = np.full((len(t_s), structure.node_count, 3), np.nan)
    sigma_n = np.full(force_n.shape[:2], np.inf)
    force_n[:, structure.free_nodes], sigma_n[:, structure.free_nodes] = rows[..., :3], rows[..., 3]
    return ExternalLoads(force_n, sigma_n)


def _read_blocks(
    path: Path,
    label: str,
    labels: NDArray[np.int64],
    t_s: NDArray[np.float64],
    columns: Sequence[str],
    words: Mapping[str, Callable[[str], float]] = MappingProxyType({}),
) -> NDArray[np.float64]:
    """Return (frames, labels, columns) of a table that has a row for each frame and each label, in order."""
    rows = np.array(list(CsvFile(path, ["t_s", label, *columns], words=words)))
    expected = np.stack([np.repeat(t_s, len(labels)), np.tile(labels, len(t_s))], axis=1)
    if rows.shape[:1] != expected.shape[:1] or not np.array_equal(rows[:, :2], expected):
        which = f"{len(labels)} rows ({label} {labels[0]} to {labels[-1]})"
        raise InputError(f"{path}: expected {which} for each row of shape.csv")
    return rows[:, 2:].reshape(len(t_s), len(labels), len(columns))


def _number(cell: str) -> float:
    """Return a number that may be nan or inf."""
    try:
        return float(cell)
    except ValueError as error:
        raise ValueError("expected a number, nan or inf") from error


def _mode(cell: str) -> float:
    try:
        return float(Mode[cell.upper()])
    except KeyError as error:
        raise ValueError(f"expected {' or '.join(mode.name.lower() for mode in Mode)}") from error


def _append(path: Path, rows: Iterator[str]) -> None:
    """Add rows to a table; the first, its header, only where there is none yet."""
    header = next(rows)
    with path.open("a", encoding="utf-8", newline="\n") as file:
        if file.tell() == 0:
            file.write(f"{header}\n")
        file.writelines(f"{row}\n" for row in rows)


def _shape_rows(r: Reconstruction) -> Iterator[str]:
    yield ",".join(["t_s", *position_columns(r.structure.node_count)])
    for t_s, position in zip(r.t_s, r.node_position_m.reshape(len(r), -1), strict=True):
        yield f"{t_s:.4f}," + ",".join(f"{value:.6f}" for value in position)


def _ellipsoid_rows(r: Reconstruction, probability: float) -> Iterator[str]:
    yield (f"t_s,node,x_m,y_m,z_m,{','.join(COVARIANCE_COLUMNS)},semi_a_m,semi_b_m,semi_c_m,qx,qy,qz,qw,probability")
    regions = r.ellipsoids(probability)
    quaternion = Rotation.from_matrix(regions.axes.reshape(-1, 3, 3)).as_quat().reshape(*regions.axes.shape[:2], 4)
    upper = np.triu_indices(3)
    covariance = r.node_covariance_m2[..., upper[0], upper[1]]
    for k, t_s in enumerate(r.t_s):
        for node in range(r.structure.node_count):
            yield (
                f"{t_s:.4f},{node},"
                + ",".join(f"{v:.6f}" for v in r.node_position_m[k, node])
                + "," + ",".join(f"{v:.9e}" for v in covariance[k, node])
                + "," + ",".join(f"{v:.6f}" for v in regions.semi_axis_m[k, node])
                + "," + ",".join(f"{v:.6f}" for v in quaternion[k, node])
                + f",{probability:g}"
            )  # fmt: skip


def _length_rows(r: Reconstruction) -> Iterator[str]:
    yield "t_s,tendon,length_m,sigma_m,mode,flags,predicted_m,innovation_sigma_m"
    modes = {int(mode): mode.name.lower() for mode in Mode}
    names = {int(flags): Flag(int(flags)).names() for flags in np.unique(r.flags)}
    for k, t_s in enumerate(r.t_s):
        for e in range(len(r.structure.tendons)):
            yield (
                f"{t_s:.4f},{e},{r.length_m[k, e]:.6f},{r.sigma_m[k, e]:.6f},{modes[int(r.mode[k, e])]},"
                f"{names[int(r.flags[k, e])]},{r.predicted_m[k, e]:.6f},{r.innovation_sigma_m[k, e]:.6f}"
            )


def _load_rows(r: Reconstruction, loads: ExternalLoads) -> Iterator[str]:
    yield "t_s,node,fx_n,fy_n,fz_n,sigma_n,observable"
    observable = observable_loads(r.structure)
    for t_s, force, sigma in zip(r.t_s, loads.force_n, loads.sigma_n, strict=True):
        for node in r.structure.free_nodes:
            values = ",".join(f"{value:.4f}" for value in (*force[node], sigma[node]))
            yield f"{t_s:.4f},{node},{values},{observable[node]}"


def _drift_rows(t_s: NDArray[np.float64], drift: NDArray[np.float64], sigma: NDArray[np.float64]) -> Iterator[str]:
    yield "t_s,tendon,drift,sigma"
    for at_s, changes, sigmas in zip(t_s, drift, sigma, strict=True):
        for e, (change, spread) in enumerate(zip(changes, sigmas, strict=True)):
            yield f"{at_s:.4f},{e},{change:.6f},{spread:.6f}"


def _status_rows(r: Reconstruction) -> Iterator[str]:
    yield "t_s,status,smallest_singular_value,mechanism_sigma_m,branch,other_log_ratio"
    columns = (r.t_s, r.status, r.smallest_singular_value, r.mechanism_sigma_m, r.branch, r.others)
    for t_s, status, value, sigma_m, side, other in zip(*columns, strict=True):
        log_ratio = f"{other.log_ratio:.2f}" if other else "nan"
        yield f"{t_s:.4f},{status},{value:.6f},{sigma_m:.6f},{side:.0f},{log_ratio}"


def _other_rows(r: Reconstruction) -> Iterator[str]:
    yield ",".join(["t_s", *position_columns(r.structure.node_count)])
    for t_s, other in zip(r.t_s, r.others, strict=True):
        if other:
            yield f"{t_s:.4f}," + ",".join(f"{value:.6f}" for value in other.node_position_m.ravel())
