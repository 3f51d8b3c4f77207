"""An estimator of your own, beside the batch graph on the same lengths.

python examples/05_own_estimator.py [TRIAL]

A class that is made from structure, rest shape and settings, and turns frames of length into shapes, can stand in the
pipeline. This one is an extended Kalman filter: nodes wander, rods and tendons have their lengths.
"""

import sys
from collections.abc import Iterable, Iterator
from itertools import takewhile
from pathlib import Path

import numpy as np

import tensegraph as tg
from tensegraph.models.structure.lengths import length_jacobian, member_length_m
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.pipeline import ESTIMATORS

WANDER_M_PER_S05 = 0.02


class ExtendedKalman:
    """x: all coordinates of the free nodes; z: lengths of rods and tendons."""

    def __init__(self, structure: tg.Structure, rest: RestShape, settings: tg.Settings) -> None:
        self._structure = structure
        self._noise = settings.noise
        self._position_m = rest.node_position_m.copy()
        self._covariance_m2 = rest.covariance_m2.copy()

    def estimate(self, frames: Iterable[tg.TendonLengths]) -> Iterator[tg.Shape]:
        """Yield a shape for each frame before the next one is asked for."""
        s = self._structure
        free = s.free_coordinates
        t_s = None
        for lengths in frames:
            step_s = 0.0 if t_s is None else lengths.t_s - t_s
            t_s = lengths.t_s
            P = self._covariance_m2[np.ix_(free, free)] + WANDER_M_PER_S05**2 * step_s * np.eye(len(free))
            measured = lengths.usable & s.is_free_tendon
            members = np.concatenate([s.rods, s.tendons[measured]])
            z = np.concatenate([s.rod_length_m, lengths.length_m[measured]])
            sigma_m = np.hypot(lengths.sigma_m[measured], self._noise.stretching_m)
            R = np.diag(np.concatenate([np.full(len(s.rods), self._noise.rod_m), sigma_m]) ** 2)
            H = length_jacobian(self._position_m, members, free)
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            moved = K @ (z - member_length_m(self._position_m, members))
            self._position_m[s.free_nodes] += moved.reshape(-1, 3)
            self._covariance_m2[np.ix_(free, free)] = (np.eye(len(free)) - K @ H) @ P
            yield tg.Shape(
                t_s=t_s,
                node_position_m=self._position_m.copy(),
                covariance_m2=self._covariance_m2.copy(),
                status=tg.Status.OK,
                lengths=lengths,
            )


ESTIMATORS["extended-kalman"] = ExtendedKalman

path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "press_01"
found = {}
for method in ("batch", "extended-kalman"):
    trial = tg.open_trial(path)
    readings = takewhile(lambda row: row.host_s < 8.0, trial.readings())
    shapes = tg.stream(readings, trial.description, method)
    found[method] = tg.Reconstruction.of(trial.description.structure, shapes)
    sigma_m = found[method].node_sigma_m[:, trial.description.structure.free_nodes]
    print(f"{method:16} {len(found[method])} shapes, median sigma of a node {1e3 * np.median(sigma_m):.1f} mm")
apart_m = np.linalg.norm(found["batch"].node_position_m - found["extended-kalman"].node_position_m, axis=-1)
print(f"nodes are {1e3 * np.median(apart_m[:, 3:]):.1f} mm apart in the median, {1e3 * apart_m.max():.1f} mm at most")
