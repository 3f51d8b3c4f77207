"""Parts of one's own, in a package beside tensegraph.

pip install examples/own_parts
tensegraph reconstruct examples/press_01 --method rest-held
tensegraph reconstruct examples/press_01 --model straight
tensegraph export results/press_01 --to xyz

and in trial.toml, for a wire between two nodes whose length a draw-wire sensor measures:

[[factor]]
name = "tape"
file = "tape.csv"
nodes = [2, 8]
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import tensegraph as tg
from tensegraph.io.csv import CsvFile
from tensegraph.models.own_factor import FactorTable
from tensegraph.models.strain_front_end import StrainReading
from tensegraph.models.structure.lengths import length_jacobian, member_length_m
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.values.readings import FactorRows
from tensegraph.models.values.tables import FileName

GAUGE_FACTOR = 0.85
"""dR/R for a strain of 1."""
STRAIN_SIGMA = 0.006
"""Standard deviation of strain after taring."""
HOLDS_S = 0.1
"""Time for which a reading of the tape is used."""
SPEED_M_PER_S = 0.05
"""Standard deviation of the speed of the tape, by which a reading is wrong when it is older than its frame."""


class RestHeld:
    """Gives the rest shape, whatever the sensors say: the estimate to beat."""

    def __init__(self, structure: tg.Structure, rest: RestShape, settings: tg.Settings) -> None:
        self._position_m = rest.node_position_m
        self._covariance_m2 = rest.covariance_m2 + settings.noise.shape_prior_m**2 * np.eye(3 * structure.node_count)

    def estimate(self, frames: Iterable[tg.TendonLengths]) -> Iterator[tg.Shape]:
        """Yield a shape for each frame."""
        for lengths in frames:
            yield tg.Shape(
                t_s=lengths.t_s,
                node_position_m=self._position_m,
                covariance_m2=self._covariance_m2,
                status=tg.Status.OK,
                lengths=lengths,
            )


class Straight:
    """A sensor model: strain is dR/R over a gauge factor. It remembers nothing of earlier frames."""

    def __init__(self, tendons: int) -> None:
        self._sigma = np.full(tendons, STRAIN_SIGMA)

    def step(self, t_s: float, change: np.ndarray) -> StrainReading:
        """Return strain, sigma and mode of all tendons; the front end of the package tares the strain."""
        return StrainReading(change / GAUGE_FACTOR, self._sigma, np.full(len(change), int(tg.Mode.STRETCHING)))


@dataclass(frozen=True, slots=True)
class TapeKeys:
    """`[[factor]]` of a tape."""

    name: str
    file: FileName
    """CSV file with the columns t_s, distance_m and sigma_m."""
    nodes: tuple[int, int]
    """The two nodes between which it measures."""


class Tape:
    """A factor: the distance |x_b - x_a| of two nodes, by the latest reading of a draw-wire sensor."""

    def __init__(self, table: FactorTable, structure: tg.Structure) -> None:
        keys = table.parsed(TapeKeys)
        if len(set(keys.nodes)) < 2 or not set(keys.nodes) <= set(range(structure.node_count)):
            expected = f"two different nodes from 0 to {structure.node_count - 1}"
            raise tg.InputError(f"{table.where}: nodes: expected {expected}, got {list(keys.nodes)}")
        self._ends = np.array([keys.nodes])
        file = CsvFile(table.place / keys.file, ["t_s", "distance_m", "sigma_m"])
        self._t_s, self._distance_m, self._sigma_m = np.array(list(file)).reshape(-1, 3).T
        for row in np.flatnonzero(~((np.diff(self._t_s, prepend=-np.inf) > 0) & (self._sigma_m > 0))):
            raise tg.InputError(f"{file.path}: row {row + 2}: expected a later t_s than before, and sigma_m above 0")

    def rows(self, t_s: np.ndarray, node_position_m: np.ndarray) -> FactorRows:
        """Return one row: the distance at the positions minus the latest reading, which is used for `HOLDS_S`."""
        latest = np.searchsorted(self._t_s, t_s, side="right") - 1
        distance_m, sigma_m, read_s = (
            np.append(values, np.nan)[latest] for values in (self._distance_m, self._sigma_m, self._t_s)
        )  # nan before the first reading, whose index is -1
        age_s = t_s - read_s
        sigma_m = np.where(age_s < HOLDS_S, np.hypot(sigma_m, SPEED_M_PER_S * age_s), np.inf)
        return FactorRows(
            residual=member_length_m(node_position_m, self._ends) - distance_m[..., None],
            jacobian=length_jacobian(node_position_m, self._ends),
            sigma=sigma_m[..., None],
        )


def read_millimetres(path: Path, tendons: Sequence[int]) -> Iterator[list[float]]:
    """Yield t_s and the lengths in metres of a file of lines: milliseconds, and the length of each tendon in mm."""
    with path.open() as file:
        for line in file:
            yield [float(word) / 1000 for word in line.split()]


def write_xyz(result: tg.Reconstruction, about: Mapping[str, Any], path: Path) -> None:
    """Write the nodes of all frames as an XYZ file, in millimetres, which viewers of molecules show as a film."""
    with path.open("w") as file:
        for t_s, nodes_m in zip(result.t_s, result.node_position_m, strict=True):
            file.write(f"{len(nodes_m)}\n{about.get('trial', '')} t = {t_s:.4f} s\n")
            file.writelines(f"N {x:.3f} {y:.3f} {z:.3f}\n" for x, y, z in 1000 * nodes_m)
