"""Ellipsoids of a covariance."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from tensegraph.models.structure.shape import (
    Covariances,
    OtherShape,
    Reason,
    Shape,
    Status,
    ellipsoids,
    node_blocks,
)


class TestEllipsoids:
    def test_axes_by_hand(self) -> None:
        """Variances 1, 4, 9 along z, y, x: semi-axes 3, 2, 1 times sqrt(chi2_3(0.95)) = 2.7955."""
        region = ellipsoids(np.diag([9.0, 4.0, 1.0]), 0.95)
        np.testing.assert_allclose(region.semi_axis_m, 2.7954834829 * np.array([3, 2, 1]))
        np.testing.assert_allclose(np.abs(region.axes), np.eye(3), atol=1e-12)

    def test_are_right_handed_and_rebuild_the_covariance(self) -> None:
        a = np.random.default_rng(0).standard_normal((5, 3, 3))
        covariance = a @ a.swapaxes(-1, -2)
        region = ellipsoids(covariance, 0.68)
        np.testing.assert_allclose(np.linalg.det(region.axes), 1)
        scale = chi2.ppf(0.68, 3)
        rebuilt = np.einsum("nij,nj,nkj->nik", region.axes, region.semi_axis_m**2 / scale, region.axes)
        np.testing.assert_allclose(rebuilt, covariance, atol=1e-12)

    def test_of_an_unknown_covariance_are_unknown(self) -> None:
        """An estimator of one's own need not know it; such shapes can be saved and drawn as others."""
        region = ellipsoids(np.stack([np.full((3, 3), np.nan), np.diag([9.0, 4.0, 1.0])]), 0.95)
        assert np.isnan(region.semi_axis_m[0]).all()
        np.testing.assert_allclose(region.semi_axis_m[1], 2.7954834829 * np.array([3, 2, 1]))
        assert np.isfinite(region.quaternion).all()

    def test_hold_their_share(self) -> None:
        rng = np.random.default_rng(0)
        covariance = np.diag([4.0, 1.0, 0.25])
        points = rng.multivariate_normal(np.zeros(3), covariance, 20_000)
        region = ellipsoids(covariance, 0.5)
        inside = (((points @ region.axes) / region.semi_axis_m) ** 2).sum(axis=1) <= 1
        assert inside.mean() == pytest.approx(0.5, abs=0.02)


class TestCovariances:
    @pytest.fixture
    def covariance_m2(self):
        a = np.random.default_rng(0).standard_normal((5, 6, 6))
        return a @ a.swapaxes(-1, -2)

    def test_by_hand(self) -> None:
        held = Covariances.of([np.array([[1.0, 2, 3], [2, 4, 5], [3, 5, 6]])], 3)
        np.testing.assert_array_equal(held.upper_m2, [[1, 2, 3, 4, 5, 6]])

    def test_are_those_that_were_collected(self, covariance_m2) -> None:
        held = Covariances.of(covariance_m2, 6)
        np.testing.assert_array_equal(held.whole_m2(slice(None)), covariance_m2)
        np.testing.assert_array_equal(held.whole_m2(3), covariance_m2[3])
        np.testing.assert_array_equal(held.part(slice(1, 4)).whole_m2(slice(1, 3)), covariance_m2[2:4])
        np.testing.assert_array_equal(held.node_blocks_m2, node_blocks(covariance_m2))

    def test_of_nodes_are_unknown_between_nodes(self, covariance_m2) -> None:
        held = Covariances.of_nodes(node_blocks(covariance_m2))
        np.testing.assert_array_equal(held.node_blocks_m2, node_blocks(covariance_m2))
        assert np.isnan(held.whole_m2(slice(None))[:, :3, 3:]).all()


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (Status.OK, Status.DOUBT),
        (Status.PARTIAL, Status.DOUBT),
        (Status.PRIOR_ONLY, Status.PRIOR_ONLY),
        (Status.NOT_CONVERGED, Status.NOT_CONVERGED),
    ],
)
def test_doubt_does_not_hide_a_worse_status(rest, structure, lengths_of, before: Status, after: Status) -> None:
    shape = Shape(0.0, rest.node_position_m, np.eye(36), before, lengths_of(structure, rest.node_position_m))
    assert shape.in_doubt(Reason.IMU).status == after


@pytest.mark.parametrize("before", Status)
def test_a_second_shape_hides_no_worse_status(rest, structure, lengths_of, before: Status) -> None:
    """Statuses are in the order of how little an estimate can be trusted, and the column has the worst."""
    shape = Shape(0.0, rest.node_position_m, np.eye(36), before, lengths_of(structure, rest.node_position_m))
    told = shape.with_other(OtherShape(rest.node_position_m, 1.0))
    order = list(Status)
    assert told.status == max(before, Status.TWO_SHAPES, key=order.index)
    assert told.other is not None


def test_the_readme_shows_what_is_said_of_frames_that_are_ok() -> None:
    """A tendon without a sensor is not measured in such a frame, and the sentence does not say so."""
    readme = Path(__file__).parents[3] / "README.md"
    words = " ".join(readme.read_text(encoding="utf-8").replace("│", " ").split())
    assert f"1499 frames: {Status.OK.advice} " in words
    assert "has a sensor" in Status.OK.advice
