"""Plausibility checks of the readings of a single sensor: outliers, and codes that do not change."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..values.readings import Flag
from ..values.tables import AtLeastOne, Positive, Probability

SHORTEST_JUMP_S = 0.01
"""Shortest time in which a tendon is taken to move: noise alone changes readings at 1000 Hz by more than
`GateSettings.max_rate_per_s` allows in one step."""
GOES_ON = 1.5
"""Growth of the rate of a value that is not unusual while it moves."""
MOVES_S = 0.3
"""Time constant for which it moves: a swing rests twice in each period."""


@dataclass(frozen=True, slots=True)
class GateSettings:
    """When a reading is rejected."""

    max_rate_per_s: Positive = 4.0
    """Rate of dR/R, and of the strain of lengths, above which a reading is an outlier. In the calibration recordings,
    random motion included, less than one reading in 1000 exceeds it."""
    usual_rate_per_s: Positive = 1.0
    """The same, above which a reading is an outlier if the next one is nearer to the reading before it: a spike."""
    accept_after: AtLeastOne = 3
    """Number of successive outliers at about the same value after which the value is accepted."""
    stuck_s: Positive = 1.0
    """Time on one code after which a sensor may be stuck, see `stuck_probability`."""
    stuck_probability: Probability = 1e-9
    """Probability below which so many equal codes in succession mean that the sensor is stuck. It is estimated from how
    often the sensor's code has stayed the same before."""


class JumpGate:
    """Tells values that have jumped from the last one; a value that is read again and again is none.

    A smaller jump waits for the next value, which tells whether it is a spike or motion. Once a value moves faster than
    usual, it may go on so.
    """

    def __init__(self, settings: GateSettings, sensors: int) -> None:
        self._settings = settings
        self._accepted = np.full(sensors, np.nan)
        self._accepted_s = np.full(sensors, np.nan)
        self._rate_per_s = np.zeros(sensors)
        self._rejected = np.full(sensors, np.nan)
        self._rejections = np.zeros(sensors, dtype=np.int64)

    def outliers(self, t_s: float, value: NDArray[np.float64], sigma: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (sensors,) whether each value is one.

        Args:
            t_s: time of the measurement.
            value: (sensors,) dR/R or strain, nan where there is none.
            sigma: (sensors,) its standard deviation.
        """
        finite = np.isfinite(value)
        since_s = np.maximum(t_s - self._accepted_s, SHORTEST_JUMP_S)
        change, noise = np.abs(value - self._accepted), 8 * sigma
        largest_change = self._settings.max_rate_per_s * since_s + noise
        usual_rate_per_s = np.maximum(self._settings.usual_rate_per_s, GOES_ON * self._rate_per_s)
        jumped: NDArray[np.bool_] = finite & (change > np.minimum(usual_rate_per_s * since_s + noise, largest_change))
        if not jumped.any():
            self._rejections[finite] = 0
            self._accept(t_s, value, finite)
            return jumped
        moves_on = (self._rejections > 0) & (np.abs(value - self._rejected) < change)
        repeated = jumped & (np.abs(value - self._rejected) <= largest_change)
        self._rejections = np.where(
            repeated, self._rejections + 1, np.where(jumped, 1, np.where(finite, 0, self._rejections))
        )
        self._rejected = np.where(jumped, value, self._rejected)
        accepted = np.where(change > largest_change, self._rejections >= self._settings.accept_after, moves_on)
        outlier: NDArray[np.bool_] = jumped & ~accepted
        self._accept(t_s, value, finite & ~outlier)
        return outlier

    def _accept(self, t_s: float, value: NDArray[np.float64], accepted: NDArray[np.bool_]) -> None:
        since_s = t_s - self._accepted_s
        rate_per_s = np.abs(value - self._accepted) / np.maximum(since_s, SHORTEST_JUMP_S)
        rate_per_s = np.fmin(rate_per_s, self._settings.max_rate_per_s)
        lasting_per_s = self._rate_per_s * np.exp(-np.maximum(since_s, 0.0) / MOVES_S)
        self._rate_per_s = np.where(accepted, np.fmax(np.fmax(rate_per_s, lasting_per_s), 0.0), self._rate_per_s)
        self._accepted = np.where(accepted, value, self._accepted)
        self._accepted_s = np.where(accepted, t_s, self._accepted_s)


class StuckGate:
    """Tells sensors whose values stay the same for longer than chance allows."""

    def __init__(self, settings: GateSettings, sensors: int) -> None:
        self._settings = settings
        self._last = np.full(sensors, np.nan)
        self._same_since_s = np.full(sensors, np.nan)
        self._run_length = np.zeros(sensors)
        self._repeats = np.full(sensors, 49.0)  # with `_readings`, the prior of a sensor with little noise
        self._readings = np.full(sensors, 50.0)

    def stuck(self, t_s: float, value: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (sensors,) whether each is stuck.

        Args:
            t_s: time of the measurement.
            value: (sensors,) of any unit, nan where there is none.
        """
        finite = np.isfinite(value)
        same = finite & (value == self._last)
        # the probability of a repeat is estimated from completed runs only, because the present run is to be tested
        ended = finite & ~same
        counted = ended & np.isfinite(self._last)
        self._repeats += np.where(counted, self._run_length, 0)
        self._readings += np.where(counted, self._run_length + 1, 0)
        self._run_length = np.where(same, self._run_length + 1, np.where(ended, 0, self._run_length))
        self._same_since_s = np.where(ended, t_s, self._same_since_s)
        self._last = np.where(finite, value, self._last)
        long: NDArray[np.bool_] = same & (t_s - self._same_since_s >= self._settings.stuck_s)
        if not long.any():
            return long
        log_probability = self._run_length * np.log(self._repeats / self._readings)
        long &= log_probability < np.log(self._settings.stuck_probability)
        return long


class ReadingGate:
    """Flags outliers and stuck sensors among the sensors of one source, and replaces their values by nan."""

    def __init__(self, settings: GateSettings, sensors: int) -> None:
        self._jumps = JumpGate(settings, sensors)
        self._repeats = StuckGate(settings, sensors)

    def check(
        self, t_s: float, value: NDArray[np.float64], sigma: NDArray[np.float64], flags: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the values, nan where they are rejected, and the flags with the reasons added.

        Args:
            t_s: time of the measurement.
            value: (sensors,) dR/R, nan where there is none.
            sigma: (sensors,) standard deviation of dR/R.
            flags: (sensors,) `Flag` bits set so far.
        """
        outlier = self._jumps.outliers(t_s, value, sigma)
        stuck = self._repeats.stuck(t_s, value)
        flags = flags | np.where(outlier, int(Flag.OUTLIER), 0) | np.where(stuck, int(Flag.STUCK), 0)
        return np.where(outlier | stuck, np.nan, value), flags
