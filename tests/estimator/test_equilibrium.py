"""What the balance of forces gives the estimators: the mechanism, and loads."""

from dataclasses import replace

import numpy as np
import pytest

from balance import pressed
from tensegraph import Settings
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.estimator.smoother import LiveSmoother


class TestLoads:
    @pytest.mark.parametrize("estimator", [FrameEstimator, LiveSmoother, BatchOptimizer])
    def test_a_known_press_comes_back(self, estimator, structure, balanced, lengths_of) -> None:
        """2 N down at node 5, lengths good to 0.1 mm: the load at 5 and at no other node."""
        load = np.zeros((12, 3))
        load[5] = [0.3, 0, -2.0]
        shapes = [balanced.node_position_m] * 5 + [pressed(structure, balanced, load * k / 15) for k in range(16)]
        shapes += shapes[-1:] * 30  # held for longer than loads are averaged over
        frames = [lengths_of(structure, x, 0.02 * k, 1e-4) for k, x in enumerate(shapes)]
        exact = replace(balanced, covariance_m2=1e-4 * balanced.covariance_m2)
        shape = list(estimator(structure, exact, Settings()).estimate(frames))[-1]
        np.testing.assert_allclose(shape.node_position_m, shapes[-1], atol=0.001)
        assert shape.loads.force_n[5] == pytest.approx(load[5], abs=0.3)
        others = np.delete(np.arange(3, 12), 2)
        assert np.linalg.norm(shape.loads.force_n[others], axis=1).max() < 0.2
        assert shape.loads.sigma_n[5] < 0.5
        assert np.isinf(shape.loads.sigma_n[0])


@pytest.mark.parametrize("told", ["of no rest", "that it rests"])
def test_a_trial_that_does_not_begin_at_rest_is_not_pulled_there(told: str, structure, balanced, lengths_of) -> None:
    """Exact lengths of a pressed shape from the first frame on: it is found at once, live and batch."""
    load = np.zeros((12, 3))
    load[8] = [0, 2.0, -2.0]
    true = pressed(structure, balanced, load)
    frames = [lengths_of(structure, true, 0.02 * k, 2e-4) for k in range(6)]
    exact = replace(balanced, covariance_m2=1e-2 * balanced.covariance_m2)
    for estimator in (LiveSmoother, BatchOptimizer):
        for shape in estimator(structure, replace(exact, at_start=told == "that it rests"), Settings()).estimate(
            frames
        ):
            assert np.abs(shape.node_position_m - true).max() < 0.001


def test_equilibrium_beats_lengths_alone(structure, balanced, lengths_of) -> None:
    """The mechanism: 0.5 mm of length error is many millimetres of node error without, about one with."""
    rng = np.random.default_rng(8)
    load = np.zeros((12, 3))
    load[10] = [1.5, 0, -1.0]
    true = pressed(structure, balanced, load)
    rmse = {}
    for name, rest in (("with", balanced), ("without", replace(balanced, mechanics=None))):
        estimator, squared = FrameEstimator(structure, rest, Settings()), []
        for _ in range(20):
            lengths = lengths_of(structure, true, sigma_m=5e-4, noise=5e-4 * rng.standard_normal(24))
            squared.append(((estimator.update(lengths).node_position_m - true) ** 2)[3:].sum(axis=1).mean())
        rmse[name] = np.sqrt(np.mean(squared))
    assert rmse["with"] < 0.0015
    assert rmse["with"] < 0.9 * rmse["without"]
