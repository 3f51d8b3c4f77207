"""Calibration recordings, and their split into training, validation and test."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch

import numpy as np
from numpy.typing import NDArray

from ..sensor.gauge import common_change
from ..sensor.lstm import running_means
from ..sensor.stretching import SETTLING_S
from ..values.errors import InputError
from ..values.time_series import median_step_s

STEADY_RATIO = 1.5
"""Ratio of the 90 % quantile to the 25 % quantile of the speed while moving, below which a recording has one speed."""
NOISY_SPEED_S = 0.5
"""Time over which the speed of a recording is taken where its strain is noisy."""
STRETCHES_SHARE = 0.3
"""Share of the samples of a recording in which its strip is stretched, from which it tells of stretching."""
BENDS_SHARE = 0.1
"""The same share, below which it only bends."""
EVERY = 6
"""Of the recordings of irregular motion every sixth is for test, and the one before it for validation."""
VALIDATION_TAIL = 0.15
"""Last share of each training recording that is for validation when there are too few whole recordings."""
TEST_TAIL = 0.3
"""Last share of each recording that is for test when there are too few whole recordings."""
CORRELATED_S = 5.0
"""Time for which the errors of curves and network last: all samples in it count as one independent sample."""


def correlated_samples(t_s: NDArray[np.float64]) -> float:
    """Return how many samples of (samples,) stamps have the same error, and count as one; at least 1."""
    return max(CORRELATED_S / median_step_s(t_s), 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One calibration recording of one sensor."""

    name: str
    t_s: NDArray[np.float64]
    """(samples,)"""
    strain: NDArray[np.float64]
    """(samples,) negative when bent."""
    change: NDArray[np.float64]
    """(samples,) dR/R, eq. (8)."""
    scored_from_s: float = -np.inf
    """Time after which samples are scored. Earlier samples are in the training and only serve to reach the sensor's
    state at this time."""

    @property
    def duration_s(self) -> float:
        """Time from the first sample to the last."""
        return float(self.t_s[-1] - self.t_s[0])

    @property
    def step_s(self) -> NDArray[np.float64]:
        """(samples,) time before each sample; before the first it is that after it."""
        return np.diff(self.t_s, prepend=2 * self.t_s[0] - self.t_s[1])

    @property
    def settled(self) -> NDArray[np.bool_]:
        """(samples,) those after the start, in which the sensor's unknown past fades; the strip is tared in it."""
        return np.asarray(self.t_s - self.t_s[0] >= SETTLING_S)

    def counted(self, unified: bool) -> NDArray[np.bool_]:
        """Return (samples,) which samples are in a loss or a score.

        They are settled, later than `scored_from_s`, and stretched; unified includes bent samples.
        """
        return self.settled & (self.t_s > self.scored_from_s) & (unified | (self.strain >= 0))

    def running_means(self, memory_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (samples, memories) running means of dR/R, see `lstm.running_means`."""
        return running_means(self.change[:, None], self.step_s[:, None], memory_s)[:, 0]

    @property
    def stretched_share(self) -> float:
        """Share of the samples in which the strip is stretched."""
        return float((self.strain >= 0).mean())

    @property
    def stretches(self) -> bool:
        """Whether the strip is stretched for long enough to tell of stretching."""
        return self.stretched_share > STRETCHES_SHARE

    @property
    def bends(self) -> bool:
        """Whether the strip is bent nearly all the time."""
        return self.stretched_share < BENDS_SHARE

    @property
    def speed_per_s(self) -> float:
        """The speed at which the strip was moved, in strain per second; nan when it was not one constant speed.

        It is that from sample to sample, or over `NOISY_SPEED_S` where the noise of strain hides it.
        """
        samples = max(round(NOISY_SPEED_S / median_step_s(self.t_s)), 1)
        by_sample, smoothed = (self._steady_speed_per_s(apart) for apart in (1, min(samples, len(self.t_s) - 1)))
        return by_sample if np.isfinite(by_sample) else smoothed

    def _steady_speed_per_s(self, apart: int) -> float:
        """Return the speed over so many samples; nan when it was not one constant speed."""
        speed = np.abs((self.strain[apart:] - self.strain[:-apart]) / (self.t_s[apart:] - self.t_s[:-apart]))
        moving = speed[speed > 0.1 * np.quantile(speed, 0.95)]
        if len(moving) < 0.5 * len(speed):
            return float("nan")
        low, middle, high = np.quantile(moving, [0.25, 0.5, 0.9])
        return float(middle) if high < STEADY_RATIO * low else float("nan")

    def part(self, from_share: float, until_share: float) -> "Recording":
        """Return the samples between two shares of the duration."""
        share = (self.t_s - self.t_s[0]) / self.duration_s
        chosen = (share >= from_share) & (share <= until_share)
        return replace(self, t_s=self.t_s[chosen], strain=self.strain[chosen], change=self.change[chosen])


def on_common_curve(recordings: Sequence[Recording], gains: Mapping[str, NDArray[np.float64]]) -> list[Recording]:
    """Return recordings with their gains and offsets removed.

    Args:
        recordings: of strips.
        gains: (2,) gain and offset of each recording, by its name.
    """
    return [replace(r, change=common_change(r.change, *gains[r.name])) for r in recordings]


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Recordings for training, validation and test; no sample is used for both training and test.

    Raises:
        InputError: when nothing but the start of a recording is left to train on.
    """

    training: Sequence[Recording]
    """Recordings to which the curves and the network are fitted."""
    validation: Sequence[Recording]
    """Recordings that decide when the training stops, and that set the scale of sigma."""
    held_out: Sequence[Recording]
    """Recordings that are only scored."""
    how: str
    """Description of the split in words."""

    def __post_init__(self) -> None:
        for r in self.training:
            if not r.settled.any():
                raise InputError(
                    f"recording {r.name}: expected more than its first {SETTLING_S:g} s to train on, got "
                    f"{r.duration_s:g} s: {self.how}"
                )

    def scored(self, unified: bool) -> list[Recording]:
        """Return the recordings held out that have a score: unified also those that bend.

        Raises:
            InputError: when there is none.
        """
        found = [r for r in self.held_out if (unified or r.stretches) and r.counted(unified).any()]
        if not found:
            names = ", ".join(r.name for r in self.held_out)
            kind = "strain" if unified else "stretching"
            raise InputError(
                f"recordings held out: expected {kind} later than {SETTLING_S:g} s in one of them, got none in {names}"
            )
        return found

    @classmethod
    def by_recordings(cls, recordings: Sequence[Recording]) -> "Split":
        """Hold out the middle one of three or more speeds, and every sixth recording of irregular motion.

        When no stretched recording is held out by this rule, the last part of each recording is held out instead.
        """
        test = {r.name for kind in (False, True) for r in _middle_speed([r for r in recordings if r.bends == kind])}
        rest = [r for r in recordings if r.name not in test]
        steady = [r for r in rest if np.isfinite(r.speed_per_s) and not r.bends]
        irregular = [r for r in rest if not np.isfinite(r.speed_per_s)]
        test |= {r.name for r in irregular[EVERY - 1 :: EVERY]}
        validate = {r.name for group in (irregular, steady) for r in group[EVERY - 2 :: EVERY]}
        if not any(r.stretches for r in recordings if r.name in test):
            return cls.by_time(recordings, TEST_TAIL)
        how = f"the middle one of the speeds and every {EVERY}th recording of irregular motion are held out"
        return cls._whole(recordings, test, validate, how)

    @classmethod
    def by_name(cls, recordings: Sequence[Recording], patterns: Sequence[str]) -> "Split":
        """Hold out the recordings whose names match one of the patterns, such as `*_0.05_*`.

        Raises:
            InputError: when a pattern matches no recording, or all of them are held out.
        """
        for pattern in patterns:
            if not any(fnmatch(r.name, pattern) for r in recordings):
                raise InputError(f"--hold-out {pattern}: fits no recording")
        test = {r.name for r in recordings if any(fnmatch(r.name, pattern) for pattern in patterns)}
        rest = [r for r in recordings if r.name not in test and not r.bends]
        validate = {r.name for r in rest[EVERY - 2 :: EVERY]}
        return cls._whole(recordings, test, validate, f"held out by name: {', '.join(patterns)}")

    @classmethod
    def by_time(cls, recordings: Sequence[Recording], tail: float) -> "Split":
        """Hold out the last part of each recording.

        Raises:
            InputError: for what is no share of a recording.
        """
        if not 0 < tail < 1:
            raise InputError(f"hold_out_tail: expected a share of each recording, above 0 and below 1, got {tail:g}")
        kept = [r.part(0, 1 - tail) for r in recordings]
        held_out = [replace(r, scored_from_s=float(k.t_s[-1])) for r, k in zip(recordings, kept, strict=True)]
        return cls(*_time_validation(kept), held_out, f"the last {tail:.0%} of each recording is held out")

    @classmethod
    def _whole(cls, recordings: Sequence[Recording], test: set[str], validate: set[str], how: str) -> "Split":
        """Split recordings by their names."""
        kept = [r for r in recordings if r.name not in test]
        validation = [r for r in kept if r.name in validate]
        training = [r for r in kept if r.name not in validate]
        if not validation:
            training, validation = _time_validation(kept)
        if not any(r.stretches for r in training):
            raise InputError(
                "no recording of stretching to train on: expected one with strain >= 0 in more than "
                f"{100 * STRETCHES_SHARE:g} % of its rows"
            )
        return cls(training, validation, [r for r in recordings if r.name in test], how)


def _middle_speed(recordings: Sequence[Recording]) -> list[Recording]:
    """Return the recordings of the middle speed when there are three speeds or more, otherwise an empty list."""
    steady = sorted((r for r in recordings if np.isfinite(r.speed_per_s)), key=lambda r: r.speed_per_s)
    groups: list[list[Recording]] = []
    for r in steady:
        if groups and r.speed_per_s < 1.25 * groups[-1][0].speed_per_s:
            groups[-1].append(r)
        else:
            groups.append([r])
    return groups[len(groups) // 2] if len(groups) >= 3 else []


def _time_validation(recordings: Sequence[Recording]) -> tuple[list[Recording], list[Recording]]:
    """Return the first part of each recording for training, and recordings scored only after it for validation.

    Recordings in which the strip only bends are not used for validation.
    """
    training = [r.part(0, 1 - VALIDATION_TAIL) for r in recordings]
    pairs = zip(recordings, training, strict=True)
    return training, [replace(r, scored_from_s=float(k.t_s[-1])) for r, k in pairs if not r.bends]
