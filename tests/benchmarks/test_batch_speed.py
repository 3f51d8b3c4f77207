"""The batch estimator beside gtsam's own optimiser, on the same graph. Not part of the default run:

pytest -n 0 tests/benchmarks/test_batch_speed.py --benchmark-only
"""

from dataclasses import dataclass

import gtsam
import numpy as np
import pytest

from tensegraph import Settings, open_trial
from tensegraph.estimator.graph import GraphBuilder
from tensegraph.estimator.whole_trial.trial_balance import TrialBalance
from tensegraph.estimator.whole_trial.trial_chain import TrialChain, minimised
from tensegraph.estimator.whole_trial.trial_factors import TrialFactors
from tensegraph.factors.motion import motion_rows
from tensegraph.factors.noise import WeightedLengths, weigh
from tensegraph.pipeline import Pipeline

FRAMES = 200
"""From 6 s on, a press and its release: gtsam alone takes seconds for them."""


@dataclass
class Press:
    """A part of the example, and the builder of its graph."""

    builder: GraphBuilder
    measured: list[WeightedLengths]
    start_m: np.ndarray

    @property
    def t_s(self) -> np.ndarray:
        return np.array([one.lengths.t_s for one in self.measured])


@pytest.fixture(scope="module")
def press(example, model) -> Press:
    trial = open_trial(example)
    pipeline = Pipeline(trial.description, Settings(), model)
    lengths = [one for one in pipeline.lengths(trial.readings()) if one.t_s >= 6][:FRAMES]
    noise = Settings().noise
    rest = pipeline.rest.node_position_m
    builder = GraphBuilder(pipeline.rest.structure, pipeline.rest, noise)
    return Press(builder, [weigh(one, noise) for one in lengths], np.tile(rest, (len(lengths), 1, 1)))


def by_gtsam(press: Press) -> np.ndarray:
    """Levenberg and Marquardt's method as gtsam has it, on its own graph."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k, measured in enumerate(press.measured):
        press.builder.add_frame(graph, k, measured)
        press.builder.add_motion(graph, k, press.t_s[max(k - 2, 0) : k + 1])
        for key, x in zip(press.builder.keys(k), press.start_m[k], strict=True):
            values.insertPoint3(key, x)
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-3)
    optimised = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    return np.array(gtsam.utilities.extractPoint3(optimised)).reshape(press.start_m.shape)


def at_once(press: Press) -> np.ndarray:
    """All frames at once, as the batch estimator has them."""
    builder, rest = press.builder, press.builder.rest
    balance = TrialBalance.of(builder, [one.lengths for one in press.measured], None)
    factors = TrialFactors(builder, press.measured, balance.near(builder, press.start_m))
    rows = motion_rows(press.t_s, builder.noise.motion_m_per_s15, rest.largest_sigma_m)
    chain = TrialChain(factors, rows, builder.structure.free_coordinates, rest.node_position_m)
    return minimised(chain, press.start_m)[0]


@pytest.mark.parametrize("optimised", [by_gtsam, at_once])
def test_shapes_of_least_error(benchmark, press, optimised) -> None:
    """Both optimise the same factors from the rest shape, to the same bound, and find shapes that are as good."""
    position_m = benchmark.pedantic(optimised, args=(press,), rounds=1)
    benchmark.extra_info["ms_per_frame"] = 1e3 * benchmark.stats.stats.mean / FRAMES
    assert np.abs(position_m - press.start_m).max() > 0.005
    assert np.median(np.linalg.norm(position_m - at_once(press), axis=-1)) < 2e-4
