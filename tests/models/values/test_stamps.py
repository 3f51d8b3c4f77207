"""When the rest at the start ends, on clocks that count from anywhere."""

import pytest

from tensegraph.models.values.stamps import RestClock, is_later, rest_until_s


@pytest.mark.parametrize("first_s", [0.0, 100.02, 1.7e9])
@pytest.mark.parametrize(("step_s", "later"), [(1e-4, True), (9e-5, False), (1e-3, True), (0.0, False), (-1.0, False)])
def test_rows_are_a_tenth_of_a_millisecond_apart_at_least(first_s, step_s, later) -> None:
    assert is_later(first_s + step_s, first_s) == later


def test_rows_on_two_sides_of_a_rounding_are_not_apart() -> None:
    assert not is_later(0.02015001, 0.02014999)


@pytest.mark.parametrize("first_s", [0.0, 0.06, 100.02, 1.7e9])
def test_the_same_frames_are_at_rest_on_every_clock(first_s) -> None:
    """By hand: 100 frames in two seconds; of some clocks the sum of t_s and seconds is rounded beyond the 101st."""
    frames_s = [first_s + k / 50 for k in range(200)]
    assert sum(t_s < rest_until_s(first_s, 2.0) for t_s in frames_s) == 100


def test_what_arrives_before_the_first_frame_is_at_rest() -> None:
    clock = RestClock(1.0)
    assert clock.is_at_rest(99.0)
    clock.count_frame(100.0)
    clock.count_frame(100.02)
    assert clock.is_at_rest(100.99)
    assert not clock.is_at_rest(101.0)


def test_without_a_rest_nothing_is_at_rest() -> None:
    clock = RestClock(0.0)
    assert not clock.is_at_rest(0.0)
    clock.count_frame(0.0)
    assert not clock.is_at_rest(0.0)
