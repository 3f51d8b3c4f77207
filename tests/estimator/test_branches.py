"""The other shape with the same lengths."""

from dataclasses import replace

import numpy as np
import pytest

from balance import pressed
from noise_settings import with_noise
from tensegraph import Settings, Status
from tensegraph.estimator.branches import OtherBranch
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.estimator.graph import MAX_FRAME_ITERATIONS, GraphBuilder
from tensegraph.estimator.rest.rest_step import rest_step
from tensegraph.models.estimation import BranchSettings, NoiseSettings
from tensegraph.models.structure.rest_shape import GeometrySigma, RestSettings
from tensegraph.models.structure.rigidity import branch
from tensegraph.models.structure.shape import Shape


def told_after_search(builder: GraphBuilder, shape: Shape) -> Shape:
    """The shape with the other one, after as many frames as the two parts of a search take at most."""
    branches = OtherBranch(builder, BranchSettings())
    for _ in range(2 * MAX_FRAME_ITERATIONS):
        told = branches.with_other(shape)
    return told


class TestBranches:
    def test_without_stiffness_the_other_shape_is_told_of(self, example_structure, true_positions, lengths_of) -> None:
        """Exact lengths alone do not tell the two apart: both are given, with the same lengths, on either side.

        With less exact ones, both are in one ellipsoid.
        """
        t_s, positions = true_positions
        true = positions[np.searchsorted(t_s, 3.4)]
        rest = rest_step(example_structure, None, positions[0], GeometrySigma(), RestSettings())
        exact = with_noise(stretching_m=1e-5, rod_m=1e-5)
        builder = GraphBuilder(example_structure, rest, exact.noise)
        shape = FrameEstimator(example_structure, rest, exact).update(lengths_of(example_structure, true, sigma_m=1e-5))
        assert shape.status == Status.TWO_SHAPES
        told = told_after_search(builder, replace(shape, other=None, status=Status.OK))
        assert told.status == Status.TWO_SHAPES
        np.testing.assert_allclose(shape.other.node_position_m, told.other.node_position_m, atol=1e-6)
        blurred = FrameEstimator(example_structure, rest, Settings()).update(lengths_of(example_structure, true))
        assert told_after_search(GraphBuilder(example_structure, rest, NoiseSettings()), blurred).status == Status.OK
        assert blurred.holds(told.other.node_position_m)
        other = told.other.node_position_m
        assert branch(example_structure, other) == -branch(example_structure, shape.node_position_m)
        np.testing.assert_allclose(
            example_structure.tendon_length_m(other), example_structure.tendon_length_m(true), atol=0.001
        )

    @pytest.mark.parametrize("step_s", [0.02, 0.1, 0.2])
    def test_a_search_takes_as_long_with_slow_frames(self, step_s, example_structure, true_positions, lengths_of):
        t_s, positions = true_positions
        true = positions[np.searchsorted(t_s, 3.4)]
        rest = rest_step(example_structure, None, positions[0], GeometrySigma(), RestSettings())
        exact = with_noise(stretching_m=1e-5, rod_m=1e-5)
        shape = FrameEstimator(example_structure, rest, exact).update(lengths_of(example_structure, true, sigma_m=1e-5))
        branches = OtherBranch(GraphBuilder(example_structure, rest, exact.noise), BranchSettings())
        alone = replace(shape, other=None, status=Status.OK)
        later_s = 0.0
        while branches.with_other(replace(alone, t_s=later_s)).status != Status.TWO_SHAPES:
            later_s += step_s
        assert 0.1 < later_s < 0.5

    def test_with_equilibrium_it_is_ruled_out(self, structure, balanced, lengths_of) -> None:
        load = np.zeros((12, 3))
        load[8] = [0, 2.0, -2.0]
        true = pressed(structure, balanced, load)
        builder = GraphBuilder(structure, balanced, NoiseSettings())
        shape = FrameEstimator(structure, balanced, Settings()).update(lengths_of(structure, true, sigma_m=2e-4))
        assert told_after_search(builder, shape).status == Status.OK
