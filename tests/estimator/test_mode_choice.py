"""The mode of each tendon, by what the rest of the structure says of its length."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Flag, Mode, Settings
from tensegraph.estimator.graph import GraphBuilder
from tensegraph.estimator.mode_choice import ModeChoice
from tensegraph.estimator.sensor_drift import DriftState
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.factors.noise import weigh
from tensegraph.models.values.readings import ModelError, ModeReadings, SensorDrift

TENDON = 13


def uncertain(lengths, true_mode: Mode, bent_m: float, probability: float):
    """The lengths with one tendon of uncertain mode: its reading is right in its true mode, and off in the other."""
    length_m = np.stack([lengths.length_m, lengths.length_m])
    length_m[int(Mode.BENDING) if true_mode is Mode.STRETCHING else int(Mode.STRETCHING), TENDON] += bent_m
    bent = np.zeros(len(lengths.length_m))
    bent[TENDON] = probability
    mixed_m = lengths.length_m.copy()
    mixed_m[TENDON] = (1 - probability) * length_m[0, TENDON] + probability * length_m[1, TENDON]
    sigma_m = lengths.sigma_m.copy()
    sigma_m[TENDON] = np.hypot(sigma_m[TENDON], bent_m * np.sqrt(probability * (1 - probability)))
    modes = ModeReadings(length_m, np.tile(lengths.sigma_m, (2, 1)), bent)
    return replace(lengths, length_m=mixed_m, sigma_m=sigma_m, modes=modes)


@pytest.mark.parametrize("true_mode", [Mode.STRETCHING, Mode.BENDING])
def test_the_shape_decides(true_mode: Mode, structure, balanced, lengths_of) -> None:
    """Readings 10 mm apart, and even odds: after a second the length is that of the true mode, with its sigma."""
    smoother = LiveSmoother(structure, balanced, Settings())
    for t in np.arange(0, 1, 0.02):
        frame = uncertain(lengths_of(structure, balanced.node_position_m, t), true_mode, 0.010, 0.5)
        frame = replace(
            frame, model_error=ModelError(np.full(24, 1e-4), frame.length_m, np.full(24, 0.01), np.zeros(24))
        )
        shape = smoother.update(frame)
    true_m = structure.tendon_length_m(balanced.node_position_m)[TENDON]
    assert shape.lengths.length_m[TENDON] == pytest.approx(true_m, abs=0.001)
    assert shape.lengths.mode[TENDON] == int(true_mode)
    assert shape.lengths.sigma_m[TENDON] < 0.003
    stretched = 2e-4 if true_mode is Mode.STRETCHING else 0.0  # with certainty, where it was with even odds
    assert shape.lengths.model_error.sigma_m[TENDON] == pytest.approx(stretched, abs=2e-5)


@pytest.mark.parametrize(("in_batch", "share"), [(False, 0.4), (True, 0.7)])
def test_evidence_by_hand(in_batch: bool, share: float, structure, balanced, lengths_of) -> None:
    """The odds after a frame that tells the mode: a share of its log-likelihood ratio, averaged over 0.1 s; in batch,
    where it is kept, a larger share of it."""
    smoother = LiveSmoother(structure, balanced, Settings())
    if in_batch:
        smoother.keep()
    choice = ModeChoice(GraphBuilder(structure, balanced, Settings().noise), 0.05)
    choice.share = smoother.modes.share
    for t_s in (0.0, 0.02):
        frame = uncertain(lengths_of(structure, balanced.node_position_m, t_s), Mode.STRETCHING, 0.010, 0.25)
        shape = smoother.update(frame)
        measured = weigh(shape.lengths, Settings().noise)
        choice.observe(shape, measured)
    told = choice.evidence(
        shape.node_position_m, shape.covariance_m2, shape.lengths.length_m, measured.sigma_m, frame.modes
    )[TENDON]
    assert told < -1
    odds = (1 - np.exp(-0.02 / 0.1)) * share * told
    bent = 1 / (1 + 3 * np.exp(-odds))
    true_m = structure.tendon_length_m(balanced.node_position_m)[TENDON]
    assert choice.choose(frame).length_m[TENDON] - true_m == pytest.approx(0.010 * bent)


def test_without_evidence_both_modes_count(structure, balanced, lengths_of) -> None:
    """The first frame: mean and variance of the two readings by hand, and the flag."""
    frame = uncertain(lengths_of(structure, balanced.node_position_m), Mode.STRETCHING, 0.010, 0.25)
    chosen = ModeChoice(GraphBuilder(structure, balanced, Settings().noise), 0.05).choose(frame)
    true_m = structure.tendon_length_m(balanced.node_position_m)[TENDON]
    assert chosen.length_m[TENDON] == pytest.approx(true_m + 0.0025)
    assert chosen.sigma_m[TENDON] == pytest.approx(np.sqrt(0.0005**2 + 0.25 * 0.75 * 0.010**2))
    assert chosen.flags[TENDON] & Flag.AMBIGUOUS
    sure = np.arange(len(structure.tendons)) != TENDON
    np.testing.assert_array_equal(chosen.length_m[sure], frame.length_m[sure])


def test_drift_is_taken_off_in_the_mode_that_is_chosen(structure, balanced, lengths_of) -> None:
    """A drift of 2 % at 0.1 m per unit of dR/R: 2 mm of a stretched tendon, none of a bent one, a quarter with both."""
    drift = SensorDrift(np.zeros(24), np.zeros(24), np.full(24, 0.1), stretched_share=np.zeros(24))
    own = DriftState(0.0, np.concatenate([np.full(24, 0.02), np.zeros(24)]), np.zeros((48, 48)))
    choice = ModeChoice(GraphBuilder(structure, balanced, Settings().noise), 0.05)
    for probability, share in ((0.25, 0.75), (0.75, 0.25)):
        frame = uncertain(lengths_of(structure, balanced.node_position_m), Mode.STRETCHING, 0.010, probability)
        chosen = choice.choose(replace(frame, drift=drift))
        corrected = own.corrected(chosen)
        taken_off_m = chosen.length_m - corrected.length_m
        assert taken_off_m[TENDON] == pytest.approx(0.002 * share)
        assert corrected.drift.change[TENDON] == pytest.approx(0.02 * share)
        assert not np.delete(taken_off_m, TENDON).any()  # which are bent by their readings alone
        assert corrected.modes.length_m[0, TENDON] == pytest.approx(frame.modes.length_m[0, TENDON] - 0.002)


def test_lengths_without_modes_stay_as_they_are(structure, balanced, lengths_of) -> None:
    frame = lengths_of(structure, balanced.node_position_m)
    assert ModeChoice(GraphBuilder(structure, balanced, Settings().noise), 0.05).choose(frame) is frame
