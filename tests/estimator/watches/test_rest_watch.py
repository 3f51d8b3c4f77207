"""Lengths at rest that are, or are not, those of the rest shape."""

import numpy as np
import pytest

from tensegraph.estimator.watches.lengths_watch import RestWatch
from tensegraph.models.values.readings import RestLengths
from told_rows import rows_of

REST_M = np.array([0.2005, 0.2, 0.21, 0.19, 0.22, 0.23])
SIGMA_M = 0.001


def in_doubt(*frames_m: np.ndarray) -> bool:
    """Return whether a watch is in doubt after some frames at rest and one later."""
    watch = RestWatch(RestLengths(1.0, REST_M, np.full(6, SIGMA_M)))
    length_m = np.array([*frames_m, REST_M])
    sigma_m = np.where(np.isfinite(length_m), SIGMA_M, np.inf)
    for row in rows_of(length_m, sigma_m, [*0.02 * np.arange(len(frames_m)), 2.0]):
        watch.observe(row)
    return watch.in_doubt


EXCHANGED_M = REST_M[[0, 1, 3, 2, 4, 5]]
NEAR_M = np.array([0.0045, -0.0045, 0, 0, 0, 0])
BLANK_M = np.where(np.arange(6) == 2, np.nan, EXCHANGED_M)


@pytest.mark.parametrize(
    ("frames_m", "expected"),
    [
        ([REST_M], False),
        ([REST_M + 0.02 * (np.arange(6) < 3)], True),
        ([REST_M + 0.02 * (np.arange(6) < 2)], False),
        ([EXCHANGED_M], True),
        ([EXCHANGED_M, BLANK_M], True),
        ([REST_M + NEAR_M], False),
        ([REST_M + np.array([-0.0075, 0.0075, 0, 0, 0, 0])], False),
        ([REST_M + 0.004 * np.array([-1, 1, -1, 1, -1, 1])], True),
        ([REST_M + 0.001 * np.array([-1, 1, -1, 1, -1, 1])], False),
    ],
    ids=[
        "right",
        "half wrong",
        "two wrong",
        "exchanged",
        "exchanged, the last cell blank",
        "two wrong by less than 5 sigmas",
        "two wrong of nearly one length",
        "offsets of three sigmas",
        "offsets of one sigma",
    ],
)
def test_half_of_the_lengths_or_two_exchanged_ones_are_doubted(frames_m, expected) -> None:
    """The limit is 7.1 mm: 5 times the sigma of both. An exchange has to explain what is wrong."""
    assert in_doubt(*frames_m) is expected


@pytest.mark.parametrize(("apart_m", "expected"), [(0.003, False), (0.005, True)])
def test_exchanged_lengths_are_doubted_by_how_much_more_probable_they_are(apart_m: float, expected: bool) -> None:
    """By hand: of 15 pairs, half of 2 d^2 / 2 sigma^2 has to be more than log(15 / 0.001) = 9.6: d of 4.4 sigma."""
    rest_m = REST_M.copy()
    rest_m[3] = rest_m[2] + apart_m
    watch = RestWatch(RestLengths(1.0, rest_m, np.full(6, SIGMA_M)))
    watch.observe(*rows_of([rest_m[[0, 1, 3, 2, 4, 5]]], SIGMA_M))
    assert watch.in_doubt is expected
