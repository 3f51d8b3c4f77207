"""Results on disk: a directory of CSV files that is written completely or not at all."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli_w
import tomlkit
from numpy.typing import NDArray

from ..models.balance.observable_loads import observable_loads
from ..models.settings import Settings, checked_settings
from ..models.structure.external_loads import ExternalLoads
from ..models.structure.floor import EstimatedNormal
from ..models.structure.quantities import UPPER_TRIANGLE
from ..models.structure.reconstruction import Reconstruction
from ..models.structure.structure import Structure
from ..models.values.readings import Flag, Mode
from ..models.values.time_series import parts
from .positions import contact_columns, position_columns
from .whole import check_replaceable, written_whole

RUN_FILE = "run.toml"
SHAPE_FILE = "shape.csv"
"""A table that every result has, and nothing else that we write."""
RESULT_FILES = (SHAPE_FILE, RUN_FILE)
"""Files that every result contains."""
LOADS_FILE = "estimated_loads.csv"
DRIFT_FILE = "sensor_drift.csv"
CONTACTS_FILE = "contacts.csv"
TRACK_FILE = "track.csv"
SLIPS_FILE = "slips.csv"
COVARIANCE_COLUMNS = tuple(filter(None, UPPER_TRIANGLE))
"""The upper triangle, row by row; ten digits, because the inverse for a long, thin ellipsoid loses seven."""
COVARIANCE_CELLS = np.triu_indices(3)
"""Rows and columns of these in the matrix."""

BLOCK_ROWS = 10_000
"""Rows of a table that are made at a time, so that a long run does not need much memory for them."""
FigureFormat = Literal["png", "pdf"]


def save(
    reconstruction: Reconstruction,
    path: str | Path,
    settings: Settings | None = None,
    *,
    figures: FigureFormat | None = "png",
) -> None:
    """Write shapes as a result directory: tables, figures, and the settings.

    Args:
        reconstruction: the shapes to write.
        path: path of the directory; an earlier result at this path is replaced.
        settings: the settings of the run; their `probability` is that of the ellipsoids.
        figures: format in which lengths and shapes are drawn, which takes some seconds; None draws nothing.

    Raises:
        InputError: when the path holds something else than an earlier result, or cannot be written.
    """
    path = Path(path)
    settings = checked_settings(settings)
    run = {"settings": asdict(settings)}
    write_result(reconstruction, path, run, settings, path.name, figures)


def write_result(
    reconstruction: Reconstruction,
    path: Path,
    run: Mapping[str, Any],
    settings: Settings,
    title: str,
    figures: FigureFormat | None,
    written: Callable[[str], None] = lambda part: None,
) -> None:
    """Write a result directory, completely or not at all.

    Args:
        reconstruction: the shapes to write.
        path: path of the directory.
        run: the content of run.toml, without what the reconstruction tells.
        settings: the settings of the run.
        title: of the figures.
        figures: their format; None draws none.
        written: called with "tables" and "figures" when they are.

    Raises:
        InputError: see `save`.
    """
    with result_directory(path) as directory:
        write_tables(reconstruction, settings.probability, directory)
        written("tables")
        if figures is not None:
            from .figures.shape_figures import write_figures  # matplotlib takes a third of a second to import

            write_figures(reconstruction, settings, title, directory, figures)
            written("figures")
        write_run({**run, **floor_table(reconstruction.floor_normal)}, reconstruction.structure, directory)


@contextmanager
def result_directory(path: Path, markers: tuple[str, ...] = RESULT_FILES) -> Iterator[Path]:
    """Give a temporary directory to write into; it is moved to `path` if the block succeeds.

    Args:
        path: of the directory.
        markers: names of files that every earlier result of the same kind contains; such a result is replaced.

    Raises:
        InputError: when anything but an earlier result exists at `path`, or it cannot be written.
    """
    check_replaceable(path, markers)
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
    """Write run.toml, after all tables, which it names; its last table is the structure, as in trial.toml."""
    names = ("rods", "tendons", "rod_length_m", "natural_length_m", "anchors", "anchor_position_m")
    table = {"structure": {name: getattr(structure, name).tolist() for name in names}}
    if len(structure.unsensed):
        table["structure"]["unsensed"] = structure.unsensed.tolist()
    tables = sorted(file.name for file in directory.glob("*.csv"))
    text = f"{tomli_w.dumps({**run, 'tables': tables})}\n{tomlkit.item(table).as_string()}"
    (directory / RUN_FILE).write_text(text, encoding="utf-8")


def floor_table(normal: EstimatedNormal | None) -> dict[str, Any]:
    """Return the table `[floor_normal]` of run.toml; nothing where the normal is told exactly, or there is no floor."""
    return {} if normal is None else {"floor_normal": asdict(normal)}


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
    yield from _rows(
        "%.4f,%d" + 3 * ",%.6f" + 6 * ",%.9e" + 7 * ",%.6f" + f",{probability:g}",
        *_each(r.t_s, np.arange(r.structure.node_count)),
        r.node_position_m.reshape(-1, 3),
        r.node_covariance_m2[..., *COVARIANCE_CELLS].reshape(-1, 6),
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
    covariance = r.centroid_covariance_m2[:, *COVARIANCE_CELLS]
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
