"""A factor of your own: a node whose height a laser measures.

python examples/06_own_factor.py [TRIAL]

Lengths alone leave one motion of the six-strut nearly free. A laser that points at one node from above sees it.
"""

import sys
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path

import numpy as np

import tensegraph as tg
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.values.readings import FactorRows
from tensegraph.pipeline import Pipeline

NODE = 8


@dataclass(frozen=True)
class Laser:
    """The height z of one node."""

    height_m: float
    sigma_m: float = 0.001

    def rows(self, t_s: np.ndarray, node_position_m: np.ndarray) -> FactorRows:
        """Return one row, z - height, at (..., nodes, 3) positions."""
        residual = node_position_m[..., NODE, 2:] - self.height_m
        jacobian = np.zeros((*residual.shape, 3 * node_position_m.shape[-2]))
        jacobian[..., 3 * NODE + 2] = 1.0
        return FactorRows(residual, jacobian, np.full(residual.shape, self.sigma_m))


trial = tg.open_trial(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "press_01")
pipeline = Pipeline(trial.description, tg.Settings(), tg.read_sensor_model())
readings = takewhile(lambda row: row.host_s < 1.5, trial.readings())
*_, lengths = pipeline.lengths(readings)  # the last frame at rest, where the laser reads the height at rest

at_rest = trial.description.rest_position_m
without_forces = RestShape(
    structure=trial.description.structure,
    node_position_m=at_rest,
    covariance_m2=pipeline.rest.covariance_m2,
    source="measured",
)
estimator = FrameEstimator(trial.description.structure, without_forces, tg.Settings())
free = trial.description.structure.free_nodes
for name, factors in (("lengths alone", ()), (f"with the height of node {NODE}", (Laser(at_rest[NODE, 2]),))):
    shape = estimator.update(replace(lengths, factors=factors))
    sigma_m = np.sqrt(np.einsum("nii->ni", shape.node_covariance_m2))
    print(f"{name:26} sigma of node {NODE} {np.round(1e3 * sigma_m[NODE], 1).tolist()} mm,", end=" ")
    print(f"of all free nodes {1e3 * np.sqrt(np.mean(np.sum(sigma_m[free] ** 2, axis=1))):.1f} mm")
