"""Motors of the twin, which wind the strings of some tendons, and what they tell of the natural lengths.

A motor follows its plan at one speed. Its drum has another radius than told, so that what is wound is u (1 + e) where u
is told, with the same small e for the whole trial.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..structure.natural_lengths import Motors
from ..structure.structure import Structure
from ..values.errors import InputError
from ..values.readings import NaturalLengthReading
from ..values.tables import NotNegative, Positive

LARGEST_NOISE = 0.1
"""Largest noise of what a motor tells, as a share of the strip: no natural length that it tells is below 0."""


@dataclass(frozen=True, slots=True)
class MotorPlan:
    """`[[motor]]`: motors that wind strings in series with the strips of some tendons, all alike."""

    tendons: list[int]
    strip_length_m: Positive
    """Natural length of each strip alone; the rest of the tendon is string."""
    at_s: list[NotNegative]
    """When the motors set out for each length, in order of time."""
    change_m: list[float]
    """These lengths: changes of the natural length since the rest; a negative one shortens the tendon."""
    speed_m_per_s: Positive
    """At which the natural length changes."""
    rate_hz: Positive
    """Rows per second of each motor."""
    noise_m: Positive
    """White noise of a row."""
    drum_sigma: NotNegative
    """Standard deviation of the error of a drum's radius, relative."""

    @property
    def motors(self) -> Motors:
        """What trial.toml tells of them."""
        return Motors(tuple(self.tendons), self.strip_length_m)

    def told_m(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (times,) the change of the natural length by the plan."""
        change_m = np.zeros(len(t_s))
        start_m = 0.0
        for k, (at_s, target_m) in enumerate(zip(self.at_s, self.change_m, strict=True)):
            way_m = target_m - start_m
            until_s = self.at_s[k + 1] if k + 1 < len(self.at_s) else np.inf
            here = t_s >= at_s
            done_m = np.minimum(self.speed_m_per_s * (t_s[here] - at_s), abs(way_m))
            change_m[here] = start_m + np.sign(way_m) * done_m
            start_m += np.sign(way_m) * min(self.speed_m_per_s * (until_s - at_s), abs(way_m))
        return change_m

    def drum_errors(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return (tendons of the table,) the e of each motor."""
        return self.drum_sigma * rng.normal(size=len(self.tendons))

    def readings(
        self, natural_length_m: Sequence[float], duration_s: float, rng: np.random.Generator
    ) -> list[NaturalLengthReading]:
        """Return the rows of all motors of the table, in order of time.

        Args:
            natural_length_m: (tendons,) as in trial.toml.
            duration_s: of the trial.
            rng: for the noise.
        """
        t_s = np.arange(0.0, duration_s, 1 / self.rate_hz)
        told_m = self.told_m(t_s)
        sigma_m = np.hypot(self.noise_m, self.drum_sigma * told_m)
        noise_m = self.noise_m * rng.normal(size=(len(t_s), len(self.tendons)))
        return [
            NaturalLengthReading(
                float(t), tendon, natural_length_m[tendon] + float(told_m[k] + noise_m[k, e]), float(sigma_m[k])
            )
            for k, t in enumerate(t_s)
            for e, tendon in enumerate(self.tendons)
        ]


def wound_m(
    motors: Sequence[MotorPlan], t_s: NDArray[np.float64], tendons: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return (times, tendons) the true change of all natural lengths."""
    change_m = np.zeros((len(t_s), tendons))
    for motor in motors:
        change_m[:, motor.tendons] = motor.told_m(t_s)[:, None] * (1 + motor.drum_errors(rng))
    return change_m


def problems_of_motors(
    motors: Sequence[MotorPlan], structure: Structure, rest_seconds: float, duration_s: float
) -> Iterator[tuple[str, str]]:
    """Yield what cannot be simulated of the motors of a plan: the dotted key, and what was expected and found."""
    seen: set[int] = set()
    for number, motor in enumerate(motors):
        here = f"motor[{number}]"
        try:
            motor.motors.check(structure)
        except InputError as error:
            key, _, text = str(error).partition(": ")
            yield f"{here}.{key}", text
            return
        if twice := seen.intersection(motor.tendons):
            yield f"{here}.tendons", f"tendon {min(twice)} has a motor already"
        seen.update(motor.tendons)
        if len(motor.change_m) != len(motor.at_s) or not motor.at_s:
            yield f"{here}.change_m", f"expected as many as at_s, at least one, got {len(motor.change_m)}"
        steps_s = np.diff([rest_seconds, *motor.at_s, duration_s])
        if steps_s[0] < 0 or steps_s[-1] <= 0 or (steps_s[1:] <= 0).any():
            expected = f"expected rising times from rest.seconds = {rest_seconds} to duration_s = {duration_s}"
            yield f"{here}.at_s", f"{expected}, got {motor.at_s}"
        largest_m = LARGEST_NOISE * motor.strip_length_m
        if motor.noise_m > largest_m:
            yield f"{here}.noise_m", f"expected at most {largest_m:.3g}, a tenth of the strip, got {motor.noise_m:g}"
        string_m = float(structure.natural_length_m[motor.tendons].min()) - motor.strip_length_m
        if motor.change_m and min(motor.change_m) < -string_m:
            yield f"{here}.change_m", f"expected at least {-string_m:.5g}, all of the string, got {min(motor.change_m)}"
