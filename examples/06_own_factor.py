"""A factor of your own in the graph of a frame: a node whose height is measured.

python examples/06_own_factor.py [TRIAL]

Lengths alone leave one motion of the six-strut nearly free. A laser that points at one node from above sees it.
"""

import sys
from itertools import takewhile
from pathlib import Path

import gtsam
import numpy as np

import tensegraph as tg
from tensegraph.estimator.graph import GraphBuilder
from tensegraph.factors.noise import isotropic, weigh
from tensegraph.io.model_file import read_sensor_model
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.pipeline import Pipeline

NODE = 8
LASER_SIGMA_M = 0.001


def height_factor(key: int, height_m: float, sigma_m: float) -> gtsam.CustomFactor:
    """Return (z - height) / sigma of one node."""

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list | None) -> np.ndarray:
        if jacobians is not None:
            jacobians[0] = np.array([[0.0, 0.0, 1.0]])
        return np.array([values.atPoint3(key)[2] - height_m])

    return gtsam.CustomFactor(isotropic(1, sigma_m), [key], error)


def estimated(trial: tg.Trial, rest: RestShape, lengths: tg.TendonLengths, height_m: float | None) -> np.ndarray:
    """Return the (nodes, 3) sigmas of one frame, with the laser or without."""
    noise = tg.Settings().noise
    builder = GraphBuilder(trial.description.structure, rest, noise)
    graph = gtsam.NonlinearFactorGraph()
    builder.add_frame(graph, 0, weigh(lengths, noise))  # anchors, rods, tendons, a weak prior about the rest shape
    if height_m is not None:
        graph.add(height_factor(builder.keys(0)[NODE], height_m, LASER_SIGMA_M))
    start = gtsam.Values()
    for key, position in zip(builder.keys(0), rest.node_position_m, strict=True):
        start.insertPoint3(key, position)
    found = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    marginals = gtsam.Marginals(graph, found)
    return np.sqrt([np.diag(marginals.marginalCovariance(key)) for key in builder.keys(0)])


trial = tg.open_trial(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "press_01")
pipeline = Pipeline(trial.description, tg.Settings(), read_sensor_model())
readings = takewhile(lambda row: row.host_s < 1.5, trial.readings())
*_, lengths = pipeline.lengths(readings)  # the last frame at rest, where the laser reads the height at rest

at_rest = trial.description.rest_position_m
without_forces = RestShape(
    structure=trial.description.structure,
    node_position_m=at_rest,
    covariance_m2=pipeline.rest.covariance_m2,
    source="measured",
)
free = trial.description.structure.free_nodes
for name, height_m in (("lengths alone", None), (f"with the height of node {NODE}", at_rest[NODE, 2])):
    sigma_m = estimated(trial, without_forces, lengths, height_m)
    print(f"{name:26} sigma of node {NODE} {np.round(1e3 * sigma_m[NODE], 1).tolist()} mm,", end=" ")
    print(f"of all free nodes {1e3 * np.sqrt(np.mean(np.sum(sigma_m[free] ** 2, axis=1))):.1f} mm")
