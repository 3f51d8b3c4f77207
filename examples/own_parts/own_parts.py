"""Parts of one's own, in a package beside tensegraph.

pip install examples/own_parts
tensegraph reconstruct examples/press_01 --method rest-held
tensegraph reconstruct examples/press_01 --model straight
tensegraph export results/press_01 --to xyz
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import tensegraph as tg
from tensegraph.models.strain_front_end import StrainReading
from tensegraph.models.structure.rest_shape import RestShape

GAUGE_FACTOR = 0.85
"""dR/R for a strain of 1."""
STRAIN_SIGMA = 0.006
"""Standard deviation of strain after taring."""


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
