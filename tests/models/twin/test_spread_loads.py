"""Hugs, lifts, shakes and wind, by hand and in their ranges."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegraph.models.twin.engine import Twin
from tensegraph.models.twin.loads import Loads, Window
from tensegraph.models.twin.spread_loads import Hug, Lift, RandomHugs, RandomLifts, RandomShakes, Shake, WindPlan
from twin_bodies import body, resting

SQUARE = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 1], [0, -1, 1], [9, 9, 9]])
"""Four nodes about (0, 0, 0.5), and one far away."""
ALWAYS = Window(0.0, 1.0, 99.0)


@pytest.mark.parametrize(
    ("axis", "first"), [((0, 0, 0), np.array([-2, 0, 1]) / np.sqrt(5)), ((0, 0, 7), np.array([-1, 0, 0]))]
)
def test_a_hug_pushes_towards_the_middle_or_the_axis(axis, first) -> None:
    hug = Hug(ALWAYS, np.arange(4), np.array([1.0, 1.0, 2.0, 2.0]), np.array(axis, dtype=float), np.zeros((4, 3)))
    force_n = Loads([hug]).force_n(50.0, SQUARE)
    np.testing.assert_allclose(force_n[0], first, atol=1e-12)
    np.testing.assert_allclose(force_n[[1, 3]], force_n[[0, 2]] * [-1, -1, 1], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(force_n, axis=1), [1, 1, 2, 2, 0], atol=1e-12)
    np.testing.assert_allclose(Loads([hug]).force_n(0.5, SQUARE), force_n / 2, atol=1e-12)


def test_a_node_in_the_middle_of_a_hug_is_not_pushed() -> None:
    hug = Hug(ALWAYS, np.arange(3), np.ones(3), np.zeros(3), np.full((3, 3), 0.1))
    force_n = hug.full_n(50.0, np.array([[1.0, 0, 0], [-1, 0, 0], [0, 0, 0]]))
    assert not force_n[2].any()
    assert np.isfinite(force_n).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([(0, 0, 0), (0, 0, 1), (1, 1, 0)]))
def test_random_hugs_stay_in_their_ranges_and_point_inwards(seed, axis) -> None:
    nodes = list(range(3, 12))
    random = RandomHugs(2.0, 29.0, (0.4, 1.5), (2.5, 4.5), 0.28, nodes, (6, 9), (0.6, 1.4), 0.3, axis, 0.0)
    position_m = resting(12)[1]
    hugs = random.draw(np.random.default_rng(seed))
    assert len(hugs) >= 4
    for hug in hugs:
        force_n = hug.full_n(0.0, position_m)
        size_n = np.linalg.norm(force_n, axis=1)
        assert 6 <= np.count_nonzero(size_n) <= 9
        assert not size_n[:3].any()
        assert 0.6 * 0.7 <= size_n[size_n > 0].min() <= size_n.max() <= 1.4 * 1.3
        assert ((position_m[hug.nodes].mean(axis=0) - position_m[hug.nodes]) * force_n[hug.nodes]).sum(axis=1).min() > 0
        np.testing.assert_allclose(force_n @ np.array(axis), 0 if any(axis) else force_n @ np.array(axis), atol=1e-12)


def test_a_wind_has_its_mean_and_its_gusts_and_does_not_turn_round() -> None:
    plan = WindPlan(
        at_s=0.0,
        ramp_s=1.0,
        nodes=[0, 2, 3],
        force_n=2.0,
        force_spread=0.5,
        direction=(0, 3, 4),
        gust_share=0.5,
        gust_period_s=(2.5, 7.0),
    )
    t_s = np.arange(1.0, 3000.0, 0.37)
    for seed in range(3):
        wind = Loads([plan.draw(np.random.default_rng(seed))])
        along = np.array([wind.force_n(t, np.zeros((4, 3))) for t in t_s]) @ [0, 0.6, 0.8]
        assert not along[:, 1].any()
        caught = along[:, [0, 2, 3]].mean(axis=0) / 2.0
        assert ((caught > 0.49) & (caught < 1.51)).all()
        np.testing.assert_allclose(along[:, [0, 2, 3]].std(axis=0) / caught, 2.0 * 0.5, rtol=0.02)
        assert along.min() >= 0


def test_a_shake_is_a_sine_of_its_frequency() -> None:
    shake = Shake(ALWAYS, np.array([1]), np.array([0.0, 0.0, 2.0]), 5.0)
    quarter_s = 1 / 20
    force_n = [Loads([shake]).force_n(10.0 + k * quarter_s, np.zeros((2, 3)))[1, 2] for k in range(4)]
    np.testing.assert_allclose(force_n, [0, 2, 0, -2], atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32))
def test_random_shakes_stay_in_their_ranges(seed) -> None:
    random = RandomShakes(
        2.0, 29.0, (0.4, 1.5), (2.0, 3.5), 0.28, [5, 8, 11], (1, 2), (2.0, 4.0), (5.0, 8.0), (0, 0, 0), (1, 1, 1)
    )
    for shake in random.draw(np.random.default_rng(seed)):
        assert 5.0 <= shake.frequency_hz <= 8.0
        assert 2.0 <= np.linalg.norm(shake.force_n) <= 4.0
        assert set(shake.nodes) <= {5, 8, 11}
        assert 2.0 <= round(2 * shake.when.ramp_s + shake.when.hold_s, 9) <= 3.5


@pytest.mark.parametrize("frequency_hz", [5.0, 8.0])
def test_a_shaken_structure_moves_at_that_frequency(frequency_hz) -> None:
    structure, shape_m = resting(12)
    twin = Twin(body(structure), 1e-3, shape_m)
    twin.settle()
    shake = Shake(Window(0.0, 0.2, 99.0), np.array([5]), np.array([2.0, 0.0, 0.0]), frequency_hz)
    moved_m = twin.run(Loads([shake]), 2000).node_position_m[1000:, 5, 0]
    spectrum = np.abs(np.fft.rfft(moved_m - moved_m.mean()))
    assert np.fft.rfftfreq(1000, 1e-3)[spectrum.argmax()] == frequency_hz
    assert np.ptp(moved_m) > 0.005


SQUARE_AND_FOOT = np.array([[1.0, 0, 1], [-1, 0, 1], [0, 2, 1], [0, -2, 0]])


def test_a_hand_lifts_carries_and_turns_the_three_highest_nodes() -> None:
    """A spring of 10 N/m; after 1 s of rise and 1 s of 2 s in the air, the hand is 0.2 m higher and has turned."""
    lift = Loads([Lift(Window(5.0, 1.0, 2.0), np.arange(4), 0.2, np.array([0.3, 0, 0]), np.pi / 2, 10.0, 0.0)])
    assert not lift.force_n(4.9, SQUARE_AND_FOOT).any()
    np.testing.assert_allclose(lift.force_n(5.0001, SQUARE_AND_FOOT), 0, atol=1e-6)
    turned = np.array([0.3, 2 / 3, 1.2]) + np.array([[2 / 3, 1, 0], [2 / 3, -1, 0], [-4 / 3, 0, 0]])
    force_n = lift.force_n(7.0, SQUARE_AND_FOOT)
    np.testing.assert_allclose(force_n[:3], 10.0 * (turned - SQUARE_AND_FOOT[:3]), atol=1e-9)
    assert not force_n[3].any(), "it is not held"
    np.testing.assert_allclose(lift.force_n(7.9, SQUARE_AND_FOOT), force_n, atol=1e-9)
    half_way = lift.force_n(8.5, SQUARE_AND_FOOT)
    np.testing.assert_allclose(half_way[:3, 2], 0.5 * 10.0 * 0.1, atol=1e-9)


def test_a_damper_in_the_hand_resists_the_node() -> None:
    lift = Loads([Lift(Window(0.0, 1.0, 9.0), np.arange(4), 0.1, np.zeros(3), 0.0, 10.0, 3.0)])
    lift.force_n(0.001, SQUARE_AND_FOOT)
    still_n = [lift.force_n(t_s, SQUARE_AND_FOOT) for t_s in (2.0, 2.1)]
    np.testing.assert_allclose(still_n[1][0], [0, 0, 1.0], atol=1e-9)
    moved_n = lift.force_n(2.2, SQUARE_AND_FOOT + np.array([0.02, 0, 0]))
    np.testing.assert_allclose(moved_n[0], [-10 * 0.02 - 3 * 0.02 / 0.1, 0, 1.0], atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32))
def test_random_lifts_stay_in_their_ranges(seed) -> None:
    when = 2.0, 29.0, (0.4, 1.5), (2.0, 3.5), 0.3
    random = RandomLifts(*when, list(range(12)), (0.05, 0.5), (0.1, 0.4), (-1.0, 2.0), 100.0, 2.0)
    for lift in random.draw(np.random.default_rng(seed)):
        assert 0.05 <= lift.height_m <= 0.5
        assert 0.1 <= np.linalg.norm(lift.way_m) <= 0.4
        assert lift.way_m[2] == 0
        assert -1.0 <= lift.turn_rad <= 2.0
