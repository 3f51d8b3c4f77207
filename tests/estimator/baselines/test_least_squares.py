"""The paper's least squares."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Settings, Status
from tensegraph.estimator.baselines.least_squares import LeastSquares


class TestLeastSquares:
    def test_least_squares_solves_the_paper_s_equations(self, example_structure, press, lengths_of) -> None:
        """As many lengths as unknowns: at the solution every rod and tendon has its length."""
        t_s, positions, rest = press
        frames = [lengths_of(example_structure, x, t) for t, x in zip(t_s[:60], positions[:60], strict=True)]
        for shape, frame in zip(
            LeastSquares(example_structure, rest, Settings()).estimate(frames), frames, strict=True
        ):
            found_m = example_structure.tendon_length_m(shape.node_position_m)[example_structure.free_tendons]
            np.testing.assert_allclose(found_m, frame.length_m[example_structure.free_tendons], atol=5e-5)

    def test_least_squares_does_not_claim_what_lengths_do_not_see(self, structure, rest, lengths_of) -> None:
        """At rest the twist is unseen: its sigma is a rod's length; with a board gone, more motions are."""
        frame = lengths_of(structure, rest.node_position_m)
        shape = LeastSquares(structure, rest, Settings()).update(frame)
        assert np.sqrt(np.linalg.eigvalsh(shape.covariance_m2)[-1]) == pytest.approx(0.3, rel=0.05)
        half = replace(frame, length_m=np.where(np.arange(24) < 12, frame.length_m, np.nan))
        half = replace(half, sigma_m=np.where(np.arange(24) < 12, frame.sigma_m, np.inf))
        shape = LeastSquares(structure, rest, Settings()).update(half)
        assert (np.sqrt(np.linalg.eigvalsh(shape.covariance_m2)) > 0.29).sum() >= 12
        assert shape.status == Status.PARTIAL

    def test_least_squares_knows_how_far_arcs_lead_from_their_tangents(self, structure, rest, lengths_of) -> None:
        """A node that the unseen twist may move by d is not known better than d^2 / L across its arc."""
        shape = LeastSquares(structure, rest, Settings()).update(lengths_of(structure, rest.node_position_m))
        sigma_m = np.sqrt(np.linalg.eigvalsh(shape.node_covariance_m2[structure.free_nodes]))
        assert (sigma_m[:, -1] > 0.05).all()
        assert (sigma_m[:, 0] > 0.8 * sigma_m[:, -1] ** 2 / 0.3).all()
