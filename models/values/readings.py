"""The values that travel from a sensor to the estimator, one dataclass a step."""

from dataclasses import dataclass
from enum import IntEnum, IntFlag

import numpy as np
from numpy.typing import NDArray


class Mode(IntEnum):
    """How a tendon is strained, eq. (3)."""

    STRETCHING = 0
    BENDING = 1


class Flag(IntFlag):
    """What is wrong with a sensor's reading; more than one may hold."""

    MISSING = 1
    """No usable reading near the frame: the tendon is left out of it."""
    SATURATED = 2
    """The ADC read 0 or full scale: a bound on the resistance, not a value."""
    OUT_OF_RANGE = 4
    """Outside what the sensor model was trained on; sigma is widened."""
    TOO_FAST = 8
    """Changes faster than the sensor model was trained on; sigma is widened."""
    WARMING_UP = 16
    """The sensor's loading history is not known yet; sigma is widened."""
    AMBIGUOUS = 32
    """Stretching and bending explain the reading about as well; sigma spans both."""
    OUTLIER = 64
    """A reading was left out because it jumped away and back faster than any tendon moves."""
    STUCK = 128
    """The same code for longer than noise allows: the tendon is left out."""
    IMPLAUSIBLE = 256
    """Without it all other sensors and the balance of forces agree, with it they do not: left out until it agrees."""
    MISFIT = 512
    """Reads at rest what no sensor on this tendon would (wrong natural resistance, or wiring): left out."""

    def names(self) -> str:
        """Return the names, joined by `|`, as in lengths.csv."""
        return "|".join((flag.name or "").lower() for flag in Flag if flag in self)

    @classmethod
    def of_names(cls, text: str) -> "Flag":
        """Return the flags that `names` gave.

        Raises:
            ValueError: for a name that is none.
        """
        flags = cls(0)
        for name in filter(None, text.strip().split("|")):
            if name.upper() not in cls.__members__:
                raise ValueError("expected names of flags joined by |")
            flags |= cls[name.upper()]
        return flags


MOMENTARY = Flag.TOO_FAST | Flag.WARMING_UP | Flag.AMBIGUOUS
"""Flags that tell of a moment; any other tells of a sensor."""
LEFT_OUT = Flag.MISSING | Flag.OUTLIER | Flag.IMPLAUSIBLE | Flag.MISFIT
"""Flags for which a length is left out."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardReading:
    """One row of one board, as it arrived."""

    board: int
    """Index of the board in the trial."""
    host_s: float
    """Arrival on the host clock."""
    seq: int
    """The board's 16-bit row counter."""
    device_us: int
    """The board's 32-bit clock."""
    counts: NDArray[np.int64]
    """(channels,) ADC codes."""
    boot: int = 0
    """How often the board has started."""


@dataclass(frozen=True, slots=True, eq=False)
class ResistanceReading:
    """One instant of the sensors that are read together, eq. (1)."""

    source: int
    """Which board, or 0 when one file holds all sensors."""
    t_s: float
    """When it was measured, host clock."""
    arrival_s: float
    """When it reached the host: nothing may use it earlier."""
    tendon: NDArray[np.int64]
    """(channels,) the tendon of each sensor."""
    resistance_ohm: NDArray[np.float64]
    """(channels,) nan where there is none."""
    sigma_ohm: NDArray[np.float64]
    """(channels,) sigma of the electronics alone."""
    flags: NDArray[np.int64]
    """(channels,) `Flag` bits."""


@dataclass(frozen=True, slots=True, eq=False)
class ResistanceFrame:
    """One instant of all sensors at the output rate."""

    t_s: float
    resistance_ohm: NDArray[np.float64]
    """(tendons,) nan where no usable reading is near."""
    sigma_ohm: NDArray[np.float64]
    """(tendons,)"""
    flags: NDArray[np.int64]
    """(tendons,) `Flag` bits."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorDrift:
    """What resistance does that no strain explains, relative to it: what was taken off the readings of one instant."""

    change: NDArray[np.float64]
    """(tendons,)"""
    sigma: NDArray[np.float64]
    """(tendons,) of `change`."""
    per_change_m: NDArray[np.float64]
    """(tendons,) how much length a relative change of resistance makes."""
    own_rate_per_s: float = 0.0
    """Sigma of the rate at which each sensor drifts in a way of its own; 0 where that is no more than in calibration,
    whose drift is in the lengths' sigma already."""
    references: int = 0
    """How many tendons of known length the drift common to all sensors is from."""
    covariance_m2: NDArray[np.float64] | None = None
    """(tendons, tendons) what is left of own drift in the lengths, where it was estimated; sigma_m holds it, too."""


@dataclass(frozen=True, slots=True, eq=False)
class TendonLengths:
    """One instant of all tendons, eq. (4): the measurement that the factor graph takes."""

    t_s: float
    length_m: NDArray[np.float64]
    """(tendons,) nan where there is none."""
    sigma_m: NDArray[np.float64]
    """(tendons,) of the reading; inf where there is none."""
    mode: NDArray[np.int64]
    """(tendons,) `Mode`."""
    flags: NDArray[np.int64]
    """(tendons,) `Flag` bits."""
    rest_sigma_m: NDArray[np.float64] | float = 0.0
    """(tendons,) the part of sigma_m that comes from the rest shape, to which the sensors were tared."""
    lag_s: float = 0.0
    """By how much the lengths lag behind t_s, for those who can wait for later ones."""
    drift: SensorDrift | None = None
    """What was taken off as drift; None where lengths come without resistance."""

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(tendons,) which lengths are measurements."""
        return np.isfinite(self.length_m) & np.isfinite(self.sigma_m)


@dataclass(frozen=True, slots=True, eq=False)
class RestLengths:
    """The tendon lengths while the structure stands unloaded at its rest shape."""

    seconds: float
    """How long it stands there at the start."""
    length_m: NDArray[np.float64]
    """(tendons,)"""
    sigma_m: NDArray[np.float64]
    """(tendons,)"""
