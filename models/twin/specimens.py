"""A strain sensor as a physical specimen: from the history of its strain to its resistance.

The paper's estimator learns a network from recordings; this is none, but textbook rheology, so that the two can
disagree. With e = max(strain, 0) and b = min(strain, 0), the resistance change dR/R heads for

    y* = G S(D) (g(e) + sum_j a_j q_j - sum_i w_i s_i) + f(b)

    g      piecewise linear gauge curve, its corners rounded: slopes GF1, GF2, ... (the paper's Fig. 4D)
    q_j    overstress of a Maxwell element: dq/dt = de/dt - q / tau_j, so that fast stretching reads higher
    s_i    stop of half width r_i (Prandtl-Ishlinskii): ds = de while |s| <= r_i. Rate-independent hysteresis: at the
           same strain, a strip reads lower while it is stretched than while it returns
    S(D)   = 1 - softening (1 - exp(-D / D0)), D the strain travelled so far (Mullins; the paper's Fig. 4C)
    f(b)   eq. (9) of a bent strip
    G      the specimen's own gain, about 1

and lags behind it by a time constant of its own for rising and falling, stretched and bent (the paper's response
times, which are to 90 %, are 2.303 time constants):

    dy/dt = (y* - y) / tau
    R = R0 (1 + y + drift) (1 + noise)

Drift is an Ornstein-Uhlenbeck process, noise white from row to row.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..sensor.bending import BendingCurve
from ..values.tables import NotNegative, Positive
from ..values.time_series import low_pass_weight


@dataclass(frozen=True, slots=True)
class SensorPhysics:
    """`[sensors]` of a plan: what one kind of sensor is like. Gains are dR/R per strain."""

    natural_resistance_ohm: Positive
    """Mean R0."""
    natural_resistance_spread: NotNegative
    """Relative standard deviation over specimens."""
    natural_resistance_error: NotNegative
    """Relative, of the R0 that is measured before mounting and stands in trial.toml."""
    gain_spread: NotNegative
    """Standard deviation of G over specimens."""
    gauge_factor: list[float]
    """GF1, GF2, ..."""
    gauge_corner_strain: list[Positive]
    """Between them, rising; one fewer."""
    gauge_corner_width: Positive
    """Strain over which a corner is round."""
    overstress_gain: list[float]
    """a_j"""
    overstress_time_s: list[Positive]
    """tau_j"""
    hysteresis_gain: list[float]
    """w_i"""
    hysteresis_strain: list[Positive]
    """r_i"""
    hysteresis_at_rest: NotNegative
    """How much of the first stretch, from zero to its length at rest, a strip's hysteresis still shows when a trial
    starts: 1 for one that was never moved since, 0 for one handled until the loops closed about that length."""
    softening: NotNegative
    """Share of the gain that is lost in the end."""
    softening_strain: Positive
    """D0"""
    stretching_time_s: tuple[Positive, Positive]
    """tau while y rises, and falls."""
    bending_time_s: tuple[Positive, Positive]
    drift_sigma: NotNegative
    """Standard deviation of the drift of dR/R."""
    drift_time_s: Positive
    """Its correlation time."""
    noise_sigma: NotNegative
    """White noise, relative to R."""
    noise_share: NotNegative
    """White noise in proportion to |y|, on top."""

    def gauge(self, strain: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return g at a strain >= 0."""
        change: NDArray[np.float64] = self.gauge_factor[0] * strain
        width = self.gauge_corner_width
        for corner, step in zip(self.gauge_corner_strain, np.diff(self.gauge_factor), strict=True):
            at_zero = np.logaddexp(0.0, -corner / width)
            change = change + step * width * (np.logaddexp(0.0, (strain - corner) / width) - at_zero)
        return change


@dataclass(frozen=True, slots=True)
class HysteresisPlan:
    """`[hysteresis]` of a plan: factors on what the sensors of `[sensors]` remember of their past."""

    hysteresis: NotNegative
    """Factor on every w_i, and so on the width of the loops."""
    creep: NotNegative
    """Factor on every a_j: how much higher fast stretching reads, and how far the reading creeps back when the strain
    is held."""

    def applied(self, physics: SensorPhysics) -> SensorPhysics:
        """Return the sensors with these factors."""
        return replace(
            physics,
            hysteresis_gain=[self.hysteresis * gain for gain in physics.hysteresis_gain],
            overstress_gain=[self.creep * gain for gain in physics.overstress_gain],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Specimens:
    """The sensors of one structure, one a tendon."""

    natural_resistance_ohm: NDArray[np.float64]
    """(tendons,) true R0."""
    measured_resistance_ohm: NDArray[np.float64]
    """(tendons,) as the trial says it."""
    gain: NDArray[np.float64]
    """(tendons,) G"""

    @classmethod
    def draw(cls, physics: SensorPhysics, count: int, rng: np.random.Generator) -> "Specimens":
        """Return what one seed makes of the spread."""
        resistance_ohm = physics.natural_resistance_ohm * (
            1 + physics.natural_resistance_spread * rng.normal(size=count)
        )
        measured_ohm = resistance_ohm * (1 + physics.natural_resistance_error * rng.normal(size=count))
        return cls(resistance_ohm, measured_ohm, 1 + physics.gain_spread * rng.normal(size=count))


class Sensors:
    """All sensors of one structure, with their history.

    Args:
        physics: of their kind.
        gain: (tendons,) G of each.
        strain: (tendons,) at which each has stood for long.
    """

    def __init__(self, physics: SensorPhysics, gain: NDArray[np.float64], strain: NDArray[np.float64]) -> None:
        self._physics = physics
        self._gain = gain
        self._bending = BendingCurve()
        column = (slice(None), None)
        self._overstress_gain, self._overstress_s = (
            np.array(values, dtype=np.float64)[column]
            for values in (physics.overstress_gain, physics.overstress_time_s)
        )
        self._stop_gain, self._stop_width = (
            np.array(values, dtype=np.float64)[column]
            for values in (physics.hysteresis_gain, physics.hysteresis_strain)
        )
        self._stretch = np.maximum(strain, 0.0)
        self._travelled = self._stretch.copy()
        self._overstress = np.zeros((len(self._overstress_gain), len(strain)))
        self._stop = physics.hysteresis_at_rest * np.minimum(self._stretch, self._stop_width)
        self._change = self._target(strain)

    def changes(self, strain: NDArray[np.float64], step_s: float) -> Iterator[NDArray[np.float64]]:
        """Yield (tendons,) y at each of the (steps, tendons) strains, `step_s` apart."""
        decay = np.exp(-step_s / self._overstress_s)
        share = {
            bent: low_pass_weight(step_s, np.array(times_s))
            for bent, times_s in ((False, self._physics.stretching_time_s), (True, self._physics.bending_time_s))
        }
        for now in strain:
            stretch = np.maximum(now, 0.0)
            step = stretch - self._stretch
            self._stretch = stretch
            self._travelled += np.abs(step)
            self._overstress = decay * (self._overstress + step)
            self._stop = np.clip(self._stop + step, -self._stop_width, self._stop_width)
            ahead = self._target(now) - self._change
            rising, falling = np.where(now[:, None] < 0, share[True], share[False]).T
            self._change = self._change + np.where(ahead > 0, rising, falling) * ahead
            yield self._change

    def _target(self, strain: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return y* of the present state."""
        physics = self._physics
        memory = (self._overstress_gain * self._overstress).sum(axis=0) - (self._stop_gain * self._stop).sum(axis=0)
        soft = 1 - physics.softening * (1 - np.exp(-self._travelled / physics.softening_strain))
        stretched: NDArray[np.float64] = self._gain * soft * (physics.gauge(self._stretch) + memory)
        return stretched + self._bending.change(np.minimum(strain, 0.0))


def drift(
    physics: SensorPhysics, steps: int, count: int, step_s: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return (steps, count) of an Ornstein-Uhlenbeck process in its steady state."""
    from scipy.signal import lfilter  # a second, which what imports a plan does without

    keep = np.exp(-step_s / physics.drift_time_s)
    kicks = rng.normal(size=(steps, count)) * physics.drift_sigma
    kicks[1:] *= np.sqrt(1 - keep**2)
    return np.asarray(lfilter([1.0], [1.0, -keep], kicks, axis=0))
