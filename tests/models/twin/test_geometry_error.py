"""Hubs at the ends of rods, and a geometry that is told wrongly."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from tensegraph.models.twin.engine import Twin
from tensegraph.models.twin.geometry_error import GeometryError, ToldErrors, end_to_end_m, hub_offset_m
from tensegraph.models.twin.loads import Loads, Press
from twin_bodies import body, resting


@settings(max_examples=20, deadline=None)
@given(st.sampled_from([12, 6]), st.integers(0, 2**32))
def test_hubs_have_the_radius_told_and_lie_across_the_rod(nodes, seed) -> None:
    structure, shape_m = resting(nodes)
    offset_m = hub_offset_m(structure, shape_m, (0.005, 0.010), np.random.default_rng(seed))
    radius_m = np.linalg.norm(offset_m, axis=2)
    assert radius_m.min() >= 0.005
    assert radius_m.max() <= 0.010
    for i, j in structure.rods:
        at_rod = np.isin(structure.tendons, [i, j])
        assert np.abs(offset_m[at_rod] @ (shape_m[j] - shape_m[i])).max() < 1e-12
    assert (end_to_end_m(structure, shape_m, offset_m) < structure.tendon_length_m(shape_m)).all()


@pytest.mark.parametrize("radius_m", [0.0, 0.01])
def test_a_rod_hangs_by_its_hub_where_forces_balance(hanging, radius_m) -> None:
    """3 k (l - L0) h / l = m g, l^2 = h^2 + (0.2 - r)^2: the anchors are on no rod, and have no hub."""
    start_m = np.array([*hanging.anchor_position_m, [0, 0, -0.1], [0, 0, -0.4]])
    offset_m = hub_offset_m(hanging, start_m, (radius_m, radius_m), np.random.default_rng(0))
    twin = Twin(body(hanging, push_back=0.0, hub_offset_m=offset_m), 1e-3, start_m)
    np.testing.assert_allclose(twin.tendon_length_m, end_to_end_m(hanging, start_m, offset_m), rtol=1e-9)
    twin.settle()
    across_m = 0.2 - radius_m

    def balance(h: float) -> float:
        length = np.hypot(h, across_m)
        return 3 * 400 * (length - 0.21) * h / length - 0.03 * 9.81

    h = brentq(balance, np.sqrt(0.21**2 - across_m**2), 0.3)
    np.testing.assert_allclose(twin.node_position_m[3], [0, 0, -h], atol=3e-6)
    np.testing.assert_allclose(twin.tendon_length_m[:3], np.hypot(h, across_m), atol=3e-6)


def test_hubs_stay_on_their_rods() -> None:
    """However the structure moves, tendons end within the hubs' radii of the nodes: lengths differ by 20 mm at most."""
    structure, shape_m = resting(12)
    offset_m = hub_offset_m(structure, shape_m, (0.005, 0.010), np.random.default_rng(0))
    shortened = end_to_end_m(structure, shape_m, offset_m) / structure.tendon_length_m(shape_m)
    hubbed = replace(structure, natural_length_m=shortened * structure.natural_length_m)
    twin = Twin(body(hubbed, hub_offset_m=offset_m), 1e-3, shape_m)
    twin.settle()
    assert np.abs(twin.node_position_m - shape_m).max() < 0.01
    motion = twin.run(Loads([Press(0.1, 0.3, 0.3, [5], 3.0, (0, 0.3, -1))]), 1000)
    node_to_node_m = structure.tendon_length_m(motion.node_position_m)
    assert np.abs(motion.node_position_m - motion.node_position_m[0]).max() > 0.01
    assert np.ptp(node_to_node_m - motion.tendon_length_m, axis=0).max() > 1e-5
    assert np.abs(node_to_node_m - motion.tendon_length_m).max() < 0.02


def test_what_is_told_is_off_by_what_is_said() -> None:
    structure = resting(12)[0]
    plan = GeometryError(0.001, 0.004, 0.002, 0.003, 0.0005)
    errors = [ToldErrors.draw(plan, structure, np.random.default_rng(seed)) for seed in range(400)]
    rods, anchors, nodes, tendons = (
        np.array([getattr(error, name) for error in errors])
        for name in ("rod_length_m", "anchor_m", "rest_position_m", "natural_length_m")
    )
    assert rods.mean() == pytest.approx(0.004, abs=1e-4)
    for values, sigma_m in ((rods, 0.001), (anchors, 0.002), (nodes, 0.003), (tendons, 0.0005)):
        assert values.std() == pytest.approx(sigma_m, rel=0.05)
    assert anchors.shape[1:] == (3, 3)
    assert nodes.shape[1:] == (12, 3)
