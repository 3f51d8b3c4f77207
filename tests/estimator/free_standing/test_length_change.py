"""Whether the lengths change as they do when a structure tips."""

import numpy as np
import pytest

from tensegraph.estimator.free_standing.length_change import TIPPED_M, LengthChange
from tensegraph.models.values.readings import TendonLengths
from told_rows import rows_of

REST_S = 2.0
NOISE_M = 0.0005


def frames(length_m: np.ndarray, from_s: float = 0.0) -> list[TendonLengths]:
    """Return frames, nine or ten in 0.2 s, of (frames, tendons) lengths."""
    return rows_of(length_m, 0.0006, from_s + 0.021 * np.arange(len(length_m)))


@pytest.fixture
def noise_m() -> np.ndarray:
    """(frames, tendons) noise over 4 s."""
    return NOISE_M * np.random.default_rng(5).standard_normal((200, 24))


def looks(change: LengthChange, given: list[TendonLengths]) -> np.ndarray:
    """Return the answers after every tenth frame."""
    answers = []
    for k, lengths in enumerate(given):
        change.observe(lengths)
        if k % 10 == 9:
            answers.append(change.may_have_tipped())
    return np.array(answers)


def test_a_structure_that_stands_still_has_not_tipped(noise_m) -> None:
    answers = looks(LengthChange(REST_S), frames(0.18 + noise_m))
    assert (answers[:9] == 0).all()
    assert answers[10:].max() < 0.01


def test_a_change_as_of_a_tip_is_seen_until_it_is_past(noise_m) -> None:
    tip_m = np.outer(np.arange(200) > 140, TIPPED_M * np.random.default_rng(6).standard_normal(24))
    answers = looks(LengthChange(REST_S), frames(0.18 + noise_m + tip_m))
    assert answers[10:14].max() < 0.01
    assert answers[14:16].max() == 1
    assert answers[18:].max() < 0.01


@pytest.mark.parametrize(("change", "expected"), [(0.0, 0.5), (1.0, 0.5 * np.exp(0.5))])
def test_the_ratio_by_hand(change: float, expected: float) -> None:
    """Noise of the size of a tip, s = 1, and nu = 2 of 4 tendons: exp(-(ln 2 - q / 2)), with q = 0 or 1."""
    windows = TIPPED_M * np.array([0, 1, 1, 1, 1, 1 + change])
    given = frames(np.outer(np.repeat(windows, 10), np.ones(4)))
    watch = LengthChange(0.62)
    for lengths in given[:30]:
        watch.observe(lengths)
    assert watch.may_have_tipped() == 0
    for lengths in given[30:]:
        watch.observe(lengths)
    assert watch.may_have_tipped() == pytest.approx(expected)


def test_a_tendon_that_is_left_out_does_not_count(noise_m) -> None:
    """One sensor jumps by 20 mm, and its sigma is infinite."""
    given = frames(0.18 + noise_m)
    for lengths in given[120:]:
        lengths.length_m[3] += 0.02
        lengths.sigma_m[3] = np.inf
    assert looks(LengthChange(REST_S), given)[10:].max() < 0.01


def test_after_a_gap_it_may_have_tipped(noise_m) -> None:
    change = LengthChange(REST_S)
    looks(change, frames(0.18 + noise_m))
    change.observe(frames(0.18 + noise_m[:1], 10.0)[0])
    assert change.may_have_tipped() == 1
