"""The drift that reference tendons show."""

from collections.abc import Sequence

import numpy as np
import pytest

from tensegraph.models.sensor.reference_drift import (
    DriftSettings,
    ReferenceDrift,
    ReferenceTendons,
    drift_noise,
    drift_transition,
    without_drift,
)
from tensegraph.models.values.readings import ResistanceFrame


def reference_readings(
    rates_per_s: Sequence[float], seconds: float = 40.0, jump: float = 0.0
) -> tuple[list[ReferenceDrift], list[float]]:
    """Return the drift that three references show while each drifts at its rate, after 2 s, and their mean drift."""
    rng = np.random.default_rng(3)
    references = ReferenceTendons(np.array([0, 1, 2]), DriftSettings())
    found, mean = [], []
    for t_s in np.arange(0, seconds, 0.02):
        drift = np.array(rates_per_s) * max(t_s - 2.0, 0.0)
        drift[0] += jump if t_s > 20 else 0.0
        code = np.round(1500 * np.exp(drift) * np.array([0.93, 1.0, 1.04]) + rng.normal(0, 0.5, 3))
        found.append(references.step(ResistanceFrame(t_s, code, np.ones(3), np.zeros(3, dtype=np.int64))))
        mean.append(float(np.mean(rates_per_s)) * max(t_s - 2.0, 0.0))
    return found, mean


def test_transition_by_hand() -> None:
    """After ln 2 of the memory half of a rate is left, and the level has moved by rate memory / 2."""
    transition = drift_transition(1, 30 * np.log(2), 30.0)
    np.testing.assert_allclose(transition, [[1, 15], [0, 0.5]])


@pytest.mark.parametrize("step_s", [0.02, 10.0, 600.0])
def test_noise_of_two_steps_is_that_of_both(step_s: float) -> None:
    """However long sensors were silent; and a rate that was known has forgotten itself after many memories."""
    once, twice = drift_noise(step_s, 30.0), drift_noise(2 * step_s, 30.0)
    transition = drift_transition(1, step_s, 30.0)
    np.testing.assert_allclose(transition @ once @ transition.T + once, twice, rtol=1e-6, atol=1e-15)
    if step_s == 600.0:  # by hand: 2 T t - 3 T^2
        np.testing.assert_allclose(once, [[2 * 30 * 600 - 3 * 900, 30], [30, 1]], rtol=1e-6)


def test_common_drift_is_taken_off_by_hand() -> None:
    frame = ResistanceFrame(0.0, np.array([103.0, np.nan]), np.ones(2), np.zeros(2, dtype=np.int64))
    np.testing.assert_allclose(without_drift(frame, np.log(1.03)).resistance_ohm, [100, np.nan])


def test_references_that_move_alike_speak_for_a_common_drift() -> None:
    found, mean = reference_readings([5e-4, 5e-4, 5e-4])
    assert found[-1].common == pytest.approx(mean[-1], rel=0.1)
    assert abs(found[-1].common - mean[-1]) < 3 * found[-1].common_sigma
    assert all(drift.own_rate_per_s == 0 for drift in found)


def test_references_that_part_speak_for_own_drift() -> None:
    found, _ = reference_readings([7e-4, -3e-4, -4e-4])
    assert 2e-4 < found[-1].own_rate_per_s < 1e-3
    whole = found[-1].common + found[-1].own
    np.testing.assert_allclose(whole, np.array([7e-4, -3e-4, -4e-4]) * 38, atol=3 * found[-1].own_sigma.max())
    assert found[-1].own_sigma.max() < 0.003
    assert abs(found[-1].common) < 3 * found[-1].common_sigma


@pytest.mark.parametrize("jump", [0.0, 0.2])
def test_still_references_say_nothing_and_one_that_jumps_is_passed_over(jump: float) -> None:
    found, _ = reference_readings([0.0, 0.0, 0.0], jump=jump)
    assert max(abs(drift.common) for drift in found) < 1.5e-3
    assert all(drift.own_rate_per_s == 0 for drift in found)


def test_a_reference_that_stays_where_it_jumped_begins_anew_there() -> None:
    """The contact of one of three slips at 20 s; by two minutes the wider predictions would contain its jump."""
    found, mean = reference_readings([2e-4, 2e-4, 2e-4], seconds=120.0, jump=0.26)
    assert abs(found[-1].common - mean[-1]) < 3 * found[-1].common_sigma < 0.02
    assert found[-1].own_rate_per_s == 0


def test_no_reference_no_drift() -> None:
    references = ReferenceTendons(np.empty(0, dtype=np.int64), DriftSettings())
    frame = ResistanceFrame(0.0, np.ones(3), np.ones(3), np.zeros(3, dtype=np.int64))
    found = references.step(frame)
    assert (found.common, found.common_sigma, found.own_rate_per_s, found.references) == (0, 0, 0, 0)


def test_a_reference_that_starts_late_is_used_from_then_on() -> None:
    """All references come after 20 s: their drift from then on is found; a resistance of 0 before spoils nothing."""
    references = ReferenceTendons(np.array([0, 1, 2]), DriftSettings())
    for t_s in np.arange(0, 60, 0.02):
        value = 1500 * np.exp(5e-4 * max(t_s - 20, 0)) if t_s > 20 else 0.0 if t_s > 19.9 else np.nan
        with np.errstate(divide="ignore"):
            found = references.step(ResistanceFrame(t_s, np.full(3, value), np.ones(3), np.zeros(3, dtype=np.int64)))
    assert found.common == pytest.approx(0.02, rel=0.1)


def test_one_that_starts_late_agrees_with_the_others() -> None:
    """Two references drift from the start, the third is read after 30 s: it is not taken for one that parts."""
    references = ReferenceTendons(np.array([0, 1, 2]), DriftSettings())
    for t_s in np.arange(0, 60, 0.02):
        value = np.full(3, 1500 * np.exp(5e-4 * max(t_s - 2, 0)))
        value[2] = value[2] if t_s > 30 else np.nan
        found = references.step(ResistanceFrame(t_s, value, np.ones(3), np.zeros(3, dtype=np.int64)))
    assert found.common == pytest.approx(0.029, rel=0.1)
    assert found.own_rate_per_s == 0


def test_a_drift_that_begins_after_a_quarter_of_an_hour_is_found_as_soon_as_one_at_the_start() -> None:
    """The filters stay finite for so long, and no explanation is ruled out for ever."""
    rng = np.random.default_rng(3)
    references = ReferenceTendons(np.array([0, 1, 2]), DriftSettings())
    begins_s = 1000.0
    for t_s in np.arange(0, begins_s + 60.0, 0.2):
        drift = 5e-4 * max(t_s - begins_s, 0.0)
        resistance_ohm = 1500 * np.exp(drift + rng.normal(0, 0.001, 3))
        found = references.step(ResistanceFrame(t_s, resistance_ohm, np.ones(3), np.zeros(3, dtype=np.int64)))
        assert abs(found.common - drift) < 0.005
    assert found.common == pytest.approx(0.03, abs=min(0.001, 3 * found.common_sigma))


def test_a_drift_goes_on_while_its_references_are_silent() -> None:
    """For 20 s of a drift of 1e-3 /s nothing is read: it is predicted, less certain, and found again at once."""
    references = ReferenceTendons(np.array([0, 1, 2]), DriftSettings())
    rng = np.random.default_rng(3)
    sigma = {}
    for t_s in np.arange(0, 42, 0.02):
        ohm = np.round(1500 * np.exp(1e-3 * max(t_s - 2.0, 0.0)) + rng.normal(0, 0.5, 3))
        ohm = np.full(3, np.nan) if 20 < t_s < 40 else ohm
        found = references.step(ResistanceFrame(t_s, ohm, np.ones(3), np.zeros(3, dtype=np.int64)))
        sigma[round(t_s)] = found.common_sigma
        if t_s > 10:
            assert abs(found.common - 1e-3 * (t_s - 2.0)) < 4 * found.common_sigma
    assert sigma[39] > 3 * sigma[20]
    assert found.common == pytest.approx(0.04, abs=0.002)
