"""Loads over time."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegraph.models.twin.loads import Hold, Loads, Press, RandomPresses, Squeeze


def test_a_press_grows_and_fades_by_the_cosine() -> None:
    loads = Loads([Press(1.0, 0.4, 0.6, [2, 3], 2.0, (0, 3, 4))])
    shares = {0.99: 0.0, 1.1: (1 - np.sqrt(0.5)) / 2, 1.2: 0.5, 1.4: 1.0, 2.0: 1.0, 2.2: 0.5, 2.41: 0.0}
    for t_s, share in shares.items():
        force = loads.force_n(t_s, np.zeros((4, 3)))
        np.testing.assert_allclose(force, share * np.array([[0, 0, 0]] * 2 + [[0, 1.2, 1.6]] * 2), atol=1e-12)


def test_a_squeeze_follows_its_nodes_and_a_hold_stays() -> None:
    position_m = np.array([[0, 0, 0], [0.3, 0.4, 0], [1, 1, 1]])
    squeeze = Loads([Squeeze(0.0, 1.0, 9.0, (0, 1), 5.0)]).force_n(5.0, position_m)
    np.testing.assert_allclose(squeeze, [[3, 4, 0], [-3, -4, 0], [0, 0, 0]])
    hold = Loads([Hold(0.0, 1.0, [2], 5.0, (0, 0, -2))]).force_n(1e6, position_m)
    np.testing.assert_allclose(hold, [[0, 0, 0], [0, 0, 0], [0, 0, -5]])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32))
def test_random_presses_stay_in_their_ranges(seed) -> None:
    random = RandomPresses(
        2.0, 25.0, (0.4, 1.3), (1.8, 3.8), 0.28, [5, 8, 11], (1, 2), (0.9, 3.1), (0, 0, -1), (0.3, 0.3, 0)
    )
    presses = random.draw(np.random.default_rng(seed))
    starts = sorted({p.at_s for p in presses})
    for press in presses:
        duration_s = 2 * press.ramp_s + press.hold_s
        assert 1.8 <= round(duration_s, 9) <= 3.8
        assert 2.4 <= press.at_s <= press.at_s + duration_s < 25.0
        assert 0.9 <= press.force_n <= 3.1
        assert set(press.nodes) <= {5, 8, 11}
        assert press.direction[2] == -1
    assert all(1 <= sum(p.at_s == at_s for p in presses) <= 2 for at_s in starts)
    assert np.diff(starts).min() >= 1.8 + 0.4
