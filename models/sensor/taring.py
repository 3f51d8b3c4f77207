"""Taring: the gain and offset of each sensor, estimated from its readings at the rest shape."""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..values.errors import InputError
from ..values.readings import RestLengths
from ..values.stamps import RestClock
from ..values.units import OTHER_UNIT
from .bending import BendingCurve
from .gauge import StaticGauge, common_change
from .stillness import BLOCK_S, MOVING_TENDONS

CURVE_SIGMA = 0.004
"""Standard deviation of the error of the gauge curve, in dR/R."""
FOLD_SIGMA = 0.01
"""Standard deviation of the error of eq. (9), in dR/R."""
FOLD_STRAIN = 0.02
"""Rest strain below which a tendon may be bent at rest, so that `FOLD_SIGMA` is used."""
MISFIT_SIGMA = 5.0
"""Number of standard deviations above which a reading at rest cannot be explained by gain and offset. It corresponds to
a natural resistance that is wrong by 4 %. The 192 sensors of the development trials stay below 2.2."""

LEAST_REACH = 0.03
"""Strain over which the model's error becomes another one, near zero strain. In the recordings of calibration, two
errors of a strip differ in mean square by 1.8 times as much at strains 5 % apart as at the same strain, but by 1.2
times where strain is above 10 %."""

MOVED_STRAIN = 0.0082
"""Change of strain of three tendons above which the structure moved while it was tared: 1.4 mm of 0.17 m. It is larger
than the limit at the rig, where the operator is asked to tare again: in the development trials the third largest change
is 0.5 to 1.1 mm, all of it noise."""

LEAST_READINGS = 4
"""Number of readings of a block, which lasts longer where they are slow: of single ones, noise alone looks like motion
on two of eleven trials at 5 Hz."""


class Taring:
    """Converts the readings of each sensor to the common gauge curve.

    A single sensor measures y = offset + gain g(strain). At rest its strain e is known, and the difference between the
    mean reading and g(e) is split between gain and offset in proportion to their variances over sensors:

        y - g(e) = (gain - 1) g(e) + offset

    All tared lengths agree exactly with the assumed rest shape. So the estimate starts at this shape, and the error of
    the rest shape is not amplified by a factor of about twenty along the mechanism. Without a rest shape the gain is 1,
    the offset is 0, and their spread over sensors is included in sigma.
    """

    def __init__(
        self, gauge: StaticGauge, bending: BendingCurve, rest: RestLengths | None, natural_length_m: NDArray[np.float64]
    ) -> None:
        count = len(natural_length_m)
        self._gauge = gauge
        self._rest_clock = RestClock(rest.seconds if rest else 0.0)
        self.rest_strain = rest.length_m / natural_length_m - 1 if rest else np.full(count, np.nan)
        self.reach = LEAST_REACH + np.maximum(np.nan_to_num(self.rest_strain), 0.0)
        """(tendons,) change of strain over which the model's error becomes another one than at rest."""
        self.rest_change = gauge.change(self.rest_strain, bending)
        self._rest_sigma = rest.sigma_m / natural_length_m if rest else np.full(count, np.nan)
        gain_variance = (gauge.gain_sigma * self.rest_change) ** 2
        strain_variance = (gauge.slope(self.rest_strain) * self._rest_sigma) ** 2
        curve_sigma = np.where(self.rest_strain < FOLD_STRAIN, FOLD_SIGMA, CURVE_SIGMA)
        self._rest_change_sigma = np.sqrt(gain_variance + gauge.offset_sigma**2 + strain_variance + curve_sigma**2)
        self._gain_share = gain_variance / (gain_variance + gauge.offset_sigma**2 + strain_variance)
        self._tared_gain_sigma = gauge.gain_sigma * np.sqrt(1 - self._gain_share)
        self._mean = np.zeros(count)
        self._count = np.zeros(count)
        self._block = np.zeros((2, count))
        self._block_until_s = -np.inf
        self._least = np.full(count, np.inf)
        self._greatest = np.full(count, -np.inf)
        self.moved = False
        """Whether the structure moved while it was supposed to stand still, see `StillnessWatch`."""
        self.motion_sigma = np.zeros(count)
        """(tendons,) strain sigma due to motion at rest: half of the range, if the structure moved."""
        self._has_begun = False
        self.gain = np.ones(count)
        self.offset = np.zeros(count)
        self.misfit = np.zeros(count, dtype=np.bool_)
        """(tendons,) which sensors have a reading at rest that is impossible for their tendon; none when `in_doubt`."""
        self.in_doubt = False
        """Whether at least half of the sensors do not fit: then the rest shape is wrong, or there was no rest."""

    def exchanged(self, natural_resistance_ohm: NDArray[np.float64]) -> list[tuple[int, int]]:
        """Return pairs of misfit sensors that would fit if their channels were exchanged.

        Args:
            natural_resistance_ohm: (tendons,) R0, with which dR/R was computed.
        """
        pairs: list[tuple[int, int]] = []
        suspects = np.flatnonzero(self.misfit).tolist()
        if len(suspects) < 2:
            return pairs
        resistance_ohm = (1 + self._mean) * natural_resistance_ohm
        for a, b in combinations(suspects, 2):
            change = self.rest_change.copy()
            change[[a, b]] = resistance_ohm[[b, a]] / natural_resistance_ohm[[a, b]] - 1
            if self._fits(change).all():
                pairs.append((a, b))
        return pairs

    def _fits(self, change: NDArray[np.float64]) -> NDArray[np.bool_]:
        difference = np.abs(change - self.rest_change)
        return np.asarray(~(difference > MISFIT_SIGMA * self._rest_change_sigma))

    @property
    def tared(self) -> NDArray[np.bool_]:
        """(tendons,) which sensors have had a reading at rest."""
        return self._count > 0

    @property
    def rest_sigma(self) -> NDArray[np.float64]:
        """(tendons,) the strain sigma of tared sensors that is due to the rest shape; zero for other sensors."""
        return np.where(self.tared, self._rest_sigma, 0.0)

    def is_over(self, t_s: float) -> bool:
        """Whether nothing more is learned at a time: the rest is over, and its last readings have been looked at."""
        return self._has_begun and not self.is_resting(t_s) and not self._block[1].any()

    def is_resting(self, t_s: float) -> bool:
        """Whether the structure still stands at its rest shape, as it does for the rest time from the first frame."""
        return self._rest_clock.is_at_rest(t_s)

    def common_change(self, t_s: float, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (tendons,) dR/R on the common curve; while the structure rests, update gain and offset first.

        Raises:
            InputError: when the first resistances are in another unit than the natural ones.
        """
        if not self._has_begun:
            _check_unit(change)
            self._has_begun = True
        self._rest_clock.count_frame(t_s)
        if self.is_resting(t_s):
            self._learn(change)
            self._watch(t_s, change)
        elif t_s >= self._block_until_s and self._block[1].any():
            self._close_block()
        return common_change(change, self.gain, self.offset)

    def sigma(self, strain: NDArray[np.float64], change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (tendons,) the strain sigma due to gain, offset and rest shape, at a strain and its dR/R."""
        slope = self._gauge.slope(np.maximum(strain, 0))
        untared = np.hypot(self._gauge.gain_sigma * change, self._gauge.offset_sigma) / slope
        gain_sigma = self._tared_gain_sigma * (change - self.rest_change) / slope
        tared = np.sqrt(gain_sigma**2 + self.rest_sigma**2 + self.motion_sigma**2)
        return np.where(self.tared, tared, untared)

    def _watch(self, t_s: float, change: NDArray[np.float64]) -> None:
        """Add readings to the present block of the time in which the structure should stand still."""
        if t_s >= self._block_until_s and not 0 < self._block[1].max() < LEAST_READINGS:
            self._close_block()
            self._block_until_s = t_s + BLOCK_S
        seen = np.isfinite(change)
        self._block[:, seen] += np.stack([change[seen], np.ones(seen.sum())])

    def _close_block(self) -> None:
        """Compare the averages of one more block of time with those before; the last one may have too few readings."""
        if self._block[1].max() < LEAST_READINGS:
            self._block[:] = 0.0
            return
        with np.errstate(invalid="ignore"):
            mean = self._block[0] / self._block[1]
        self._block[:] = 0.0
        self._least = np.fmin(self._least, mean)
        self._greatest = np.fmax(self._greatest, mean)
        strain = np.maximum(self._greatest - self._least, 0.0) / self._gauge.slope(np.zeros(len(mean)))
        self.moved = bool((strain > MOVED_STRAIN).sum() >= MOVING_TENDONS)
        self.motion_sigma = 0.5 * strain if self.moved else np.zeros(len(strain))

    def _learn(self, change: NDArray[np.float64]) -> None:
        seen = np.isfinite(change)
        self._count += seen
        self._mean[seen] += (change[seen] - self._mean[seen]) / self._count[seen]
        misfit = self.tared & ~self._fits(self._mean)
        self.in_doubt = bool(2 * misfit.sum() >= self.tared.sum() > 0)
        self.misfit = misfit & (not self.in_doubt)
        innovation = self._mean - self.rest_change
        at_zero = np.abs(self.rest_change) < 1e-6
        share = np.where(at_zero, 0.0, self._gain_share)
        gain = 1 + share * innovation / np.where(at_zero, 1.0, self.rest_change)
        self.gain = np.where(self.tared, gain, 1.0)
        self.offset = np.where(self.tared, (1 - share) * innovation, 0.0)


class RestShift:
    """Shifts the network's strain so that its mean while the structure rests equals the known strain at rest."""

    def __init__(self, rest_strain: NDArray[np.float64]) -> None:
        self._rest_strain = np.where(rest_strain >= 0, rest_strain, np.nan)
        self._sum = np.zeros(len(rest_strain))
        self._count = np.zeros(len(rest_strain))
        self._shift = np.zeros(len(rest_strain))

    def corrected(self, strain: NDArray[np.float64], resting: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return (samples, tendons) shifted strain; of the (tendons,) that rest, the shifts are updated first.

        While some rest, there is one sample at a time.
        """
        if resting.any():
            (sample,) = strain
            self._sum += np.where(resting, sample, 0.0)
            self._count += resting
            shift = self._rest_strain - self._sum / np.maximum(self._count, 1)
            self._shift = np.where((self._count > 0) & np.isfinite(shift), shift, 0.0)
        return strain + self._shift


def _check_unit(change: NDArray[np.float64]) -> None:
    ratio = 1 + change[np.isfinite(change)]
    if len(ratio) and not 1 / OTHER_UNIT < np.median(ratio) < OTHER_UNIT:
        raise InputError(
            f"sensors.natural_resistance_ohm: the first readings are {np.median(ratio):.3g} times these: "
            "are the units of all resistances right?"
        )
