"""Result directories: a reconstruction is written as one, and read back from it."""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..models.evaluation.estimate import Estimate
from ..models.settings import Settings, checked_settings
from ..models.structure.floor import EstimatedNormal
from ..models.structure.reconstruction import Propagated, Reconstruction
from ..models.structure.shape import Covariances, OtherShape, Reason, Status
from ..models.structure.structure import Structure
from ..models.structure_description import StructureTable
from ..models.values.errors import InputError
from ..models.values.slip import Slip
from ..models.values.tables import parse_table
from .csv import CsvFile
from .positions import position_columns
from .result import (
    COVARIANCE_COLUMNS,
    DRIFT_FILE,
    RUN_FILE,
    SLIPS_FILE,
    TRACK_FILE,
    floor_table,
    number,
    read_blocks,
    read_estimate,
    read_run,
    result_directory,
    write_run,
    write_tables,
)
from .trial_directory import open_trial

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
    estimate = read_estimate(path, structure)
    frames = _FramesTable(path, estimate.t_s)
    drift, drift_sigma = _drift(path / DRIFT_FILE, estimate.t_s, len(structure.tendons))
    return Reconstruction(
        structure=structure,
        t_s=estimate.t_s,
        node_position_m=estimate.node_position_m,
        covariances=Covariances.of_nodes(estimate.node_covariance_m2),
        status=frames.status,
        length_m=estimate.length_m,
        sigma_m=estimate.sigma_m,
        mode=estimate.mode,
        flags=estimate.flags,
        loads=estimate.loads,
        others=frames.others(structure.node_count),
        doubts=frames.doubts,
        drift=drift,
        drift_sigma=drift_sigma,
        contacts=estimate.contacts,
        slips=_slips(path / SLIPS_FILE, estimate.t_s, structure.node_count),
        floor_normal=_floor_normal(path, run),
        propagated=Propagated(
            estimate.innovation_sigma_m, frames.mechanism_sigma_m, _centroid_covariance_m2(path, estimate)
        ),
    )


def _structure(path: Path, run: dict[str, Any]) -> Structure:
    """Return the structure in run.toml, or that of the trial which it names, as in results of version 0.1.0."""
    if "structure" in run:
        try:
            return parse_table(StructureTable, run["structure"], "structure").structure()
        except InputError as error:
            raise InputError(f"{path / RUN_FILE}: {error}") from error
    if not isinstance(run.get("trial_path"), str):
        raise InputError(f"{path / RUN_FILE}: structure: is missing: expected a result of this version: save it again")
    return open_trial(path / run["trial_path"]).description.structure


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
        words = {"status": _status, "doubt": _doubt, "mechanism_sigma_m": number, "other_log_ratio": number}
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


def _centroid_covariance_m2(path: Path, estimate: Estimate) -> NDArray[np.float64]:
    """Return (frames, 3, 3) of track.csv; nan where there is none."""
    covariance_m2 = np.full((len(estimate.t_s), 3, 3), np.nan)
    track = path / TRACK_FILE
    if track.is_file():
        rows = np.array(list(CsvFile(track, ["t_s", *COVARIANCE_COLUMNS]))).reshape(-1, 1 + len(COVARIANCE_COLUMNS))
        if not np.array_equal(rows[:, 0], estimate.t_s):
            raise InputError(f"{track}: expected one row for each row of shape.csv")
        row, column = np.triu_indices(3)
        covariance_m2[:, row, column] = covariance_m2[:, column, row] = rows[:, 1:]
    return covariance_m2


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
    drift[:, known] = np.moveaxis(read_blocks(path, "tendon", np.arange(tendons), t_s[known], ("drift", "sigma")), 2, 0)
    return drift[0], drift[1]
