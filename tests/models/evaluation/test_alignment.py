"""Truth at the frames' times, and in another frame of reference."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from four_nodes import estimate_of
from tensegraph.models.evaluation.alignment import interpolated_within, laid_on_each_frame, rigid_alignment
from tensegraph.models.evaluation.metrics import evaluate
from tensegraph.models.evaluation.truth import Truth


class TestInterpolated:
    TIMES = np.array([0.0, 1.0, 2.0, 7.0, 8.0])

    def at(self, *t_s, values=(0.0, 4.0, 8.0, 0.0, 2.0)) -> np.ndarray:
        positions = np.repeat(np.array(values)[:, None, None], 3, axis=2)
        return interpolated_within(np.array(t_s), self.TIMES, positions)[:, 0, 0]

    def test_on_straight_lines(self) -> None:
        np.testing.assert_allclose(self.at(0.0, 0.25, 1.0, 1.5, 8.0), [0, 1, 4, 6, 2])

    def test_never_outside_nor_in_holes(self) -> None:
        np.testing.assert_array_equal(
            self.at(-0.01, 2.0, 2.01, 6.99, 7.0, 8.01), [np.nan, 8, np.nan, np.nan, 0, np.nan]
        )

    def test_not_next_to_an_unseen_node(self) -> None:
        values = (0.0, np.nan, 8.0, 0.0, 2.0)
        np.testing.assert_array_equal(self.at(0.0, 0.5, 1.5, 2.0, values=values), [0, np.nan, np.nan, 8])


class TestLaidOnEachFrame:
    def test_nodes_that_are_hidden_stay_so_and_the_others_are_laid(self) -> None:
        """Another node is hidden in each frame, and all in the last one."""
        rng = np.random.default_rng(7)
        shape_m = rng.standard_normal((6, 5, 3))
        turns = Rotation.random(6, rng=rng).as_matrix()
        seen_m = shape_m @ np.swapaxes(turns, 1, 2) + rng.standard_normal((6, 1, 3))
        seen_m[np.arange(5), np.arange(5)] = seen_m[5] = np.nan
        laid_m = laid_on_each_frame(seen_m, shape_m)
        np.testing.assert_array_equal(np.isnan(laid_m), np.isnan(seen_m))
        np.testing.assert_allclose(np.where(np.isnan(laid_m), shape_m, laid_m), shape_m, atol=1e-12)

    @pytest.mark.parametrize("seen", [[0, 1], [0, 1, 2]])
    def test_two_points_and_points_on_one_line_are_not_laid(self, seen) -> None:
        points_m = np.full((1, 5, 3), np.nan)
        points_m[0, seen] = np.array(seen)[:, None] * np.array([0.1, 0.2, 0.0])
        assert np.isnan(laid_on_each_frame(points_m, np.random.default_rng(0).standard_normal((1, 5, 3)))).all()


class TestAlignment:
    @given(st.integers(0, 10_000))
    def test_a_rigid_motion_is_undone(self, seed) -> None:
        rng = np.random.default_rng(seed)
        points, rotation = rng.standard_normal((20, 3)), Rotation.random(rng=rng)
        found, shift = rigid_alignment(points, rotation.apply(points) + np.array([1, -2, 3]))
        assert (found * rotation.inv()).magnitude() < 1e-7
        np.testing.assert_allclose(shift, [1, -2, 3], atol=1e-9)

    def test_agrees_with_umeyama_s_formula(self) -> None:
        """With noise, R = U diag(1, 1, det U V^T) V^T of the cross-covariance U D V^T."""
        rng = np.random.default_rng(4)
        points = rng.standard_normal((30, 3))
        onto = Rotation.random(rng=rng).apply(points) + 0.2 * rng.standard_normal((30, 3))
        u, _, vt = np.linalg.svd((onto - onto.mean(0)).T @ (points - points.mean(0)))
        expected = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        found, shift = rigid_alignment(points, onto)
        np.testing.assert_allclose(found.as_matrix(), expected, atol=1e-12)
        np.testing.assert_allclose(shift, onto.mean(0) - expected @ points.mean(0), atol=1e-12)

    def test_truth_in_another_frame(self, structure, rest) -> None:
        """Turned by 90 degrees and shifted it is far off as it stands, and exact once aligned; sizes are kept."""
        rng = np.random.default_rng(5)
        position = rest.node_position_m + 0.003 * rng.standard_normal((6, 12, 3))
        turned = position @ Rotation.from_euler("z", 90, degrees=True).as_matrix().T + [1.0, 0, 0]
        truth = Truth(np.arange(6) / 50, turned, rest_seconds=0.02)
        estimate = estimate_of(structure, position)
        plain = evaluate(rest.node_position_m, estimate, truth)
        aligned = evaluate(rest.node_position_m, estimate, truth, align=True)
        assert plain.absolute.nodes.rmse_m > 0.5
        assert plain.rotation_deg is None
        assert aligned.absolute.nodes.rmse_m < 1e-12
        assert aligned.rotation_deg == pytest.approx(90)
        larger = evaluate(rest.node_position_m, estimate, replace(truth, node_position_m=1.1 * turned), align=True)
        assert larger.absolute.nodes.rmse_m > 0.005


def test_truth_is_interpolated() -> None:
    at = interpolated_within(np.array([0.25, 1.5]), np.array([0.0, 1.0, 2.0]), np.array([0.0, 4.0, 8.0])[:, None, None])
    np.testing.assert_allclose(at.ravel(), [1.0, 6.0])
