"""Positions that motion capture has not seen, and its software has filled in."""

import numpy as np
import pytest

from tensegraph.models.pose.filled_positions import FilledPositions, _third_difference
from tensegraph.models.values.aids import PositionReading


def passed(t_s: np.ndarray, position_m: np.ndarray) -> tuple[np.ndarray, dict[str, int]]:
    """Return which of the positions of node 3, rounded as in a file, are used, and the counts."""
    filled = FilledPositions()
    rows = zip(t_s.round(4), position_m.round(5), strict=True)
    used = [filled.passes(PositionReading(float(t), 3, x, 0)) for t, x in rows]
    return np.array(used), filled.counts()


def walk(count: int = 300, noise_m: float = 0.0005) -> tuple[np.ndarray, np.ndarray]:
    """Five seconds of a node that swings by 0.1 m, at 60 Hz."""
    t_s = np.arange(count) / 60
    true_m = np.stack([0.1 * np.sin(2 * t_s), 0.05 * np.cos(3 * t_s), 0.1 + 0.02 * t_s], axis=1)
    return t_s, true_m + noise_m * np.random.default_rng(2).standard_normal((count, 3))


def test_a_third_difference_by_hand() -> None:
    """Of t^3 it is 6 dt^3, also where steps differ, and of a parabola zero."""
    t_s = np.array([0.0, 0.1, 0.3, 0.45])
    powers = np.stack([t_s**3, t_s**2, t_s], axis=1)
    assert _third_difference(t_s, powers) == pytest.approx([6 * 0.15**3, 0, 0])


@pytest.mark.parametrize("noise_m", [0.00005, 0.0005, 0.005])
def test_measured_positions_pass(noise_m: float) -> None:
    used, counts = passed(*walk(noise_m=noise_m))
    assert used.all()
    assert counts == {}


@pytest.mark.parametrize("how", ["line", "hold", "cubic"])
def test_what_was_filled_in_is_left_out_after_some_positions(how: str) -> None:
    t_s, x = walk()
    gap = slice(150, 210)
    if how == "hold":
        x[gap] = x[149]
    elif how == "line":
        x[gap] = np.stack([np.interp(t_s[gap], t_s[[149, 210]], x[[149, 210], k]) for k in range(3)], axis=1)
    else:
        through = [140, 149, 210, 219]
        x[gap] = np.stack([np.polyval(np.polyfit(t_s[through], x[through, k], 3), t_s[gap]) for k in range(3)], axis=1)
    used, counts = passed(t_s, x)
    assert used[:150].all()
    assert not used[158:210].any()
    assert used[212:].all()
    assert counts == {"position of node 3: filled in": int((~used).sum())}


def test_positions_without_noise_pass() -> None:
    """Simulated, or smoothed: their differences are always as small."""
    t_s = np.arange(600) / 120
    smooth_m = np.stack([0.1 * np.sin(t_s), 0.05 * np.cos(t_s), 0.1 + 0 * t_s], axis=1)
    assert passed(t_s, smooth_m)[0].all()


@pytest.mark.parametrize("noise_m", [0.0, 1e-5])
def test_a_robot_that_rests_after_it_has_moved_is_seen(noise_m: float) -> None:
    """With less noise than the hundredth of a millimetre to which positions are rounded."""
    t_s = np.arange(3000) / 60
    moves = np.where((t_s > 5) & (t_s < 25), t_s - 5, np.where(t_s >= 25, 20.0, 0.0))
    x = np.stack([0.1 * np.sin(3 * moves), 0.05 * np.sin(7 * moves), 0.1 + 0.02 * np.sin(5 * moves)], axis=1)
    used, _ = passed(t_s, x + noise_m * np.random.default_rng(2).standard_normal(x.shape))
    assert used.mean() > 0.99


def test_two_positions_at_one_instant_and_pauses_begin_anew() -> None:
    t_s, x = walk(60)
    t_s[20] = t_s[19]
    t_s[40:] += 5.0
    assert passed(t_s, x)[0].all()
