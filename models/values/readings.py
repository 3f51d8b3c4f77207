"""The values on the way from a sensor to the estimator, one dataclass for each step of the processing."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .aids import AidReading

LEAST_PROBABILITY = 1e-3
"""Least probability of a mode that is considered."""
MOST_STRETCH = 20.0
"""Ratio of a length to the natural length, or of that to the length, above which no tendon has it."""


class Mode(IntEnum):
    """How a tendon is strained, eq. (3)."""

    STRETCHING = 0
    BENDING = 1


STRETCHING = int(Mode.STRETCHING)
"""As a plain number: comparing an array with an enumeration takes ten times as long."""
BENDING = int(Mode.BENDING)
"""As a plain number, likewise."""


class Flag(IntFlag):
    """What is wrong with a sensor's reading; several flags may be set at once."""

    MISSING = 1
    """There is no usable reading near the frame: the tendon is left out of the frame."""
    SATURATED = 2
    """The ADC read 0 or full scale, which is a bound on the resistance and not a value."""
    OUT_OF_RANGE = 4
    """The reading is outside the range on which the sensor model was trained; sigma is widened, and a length that
    no tendon has is left out."""
    TOO_FAST = 8
    """The reading changes faster than any on which the sensor model was trained; sigma is widened."""
    WARMING_UP = 16
    """The sensor's loading history is not known yet; sigma is widened."""
    AMBIGUOUS = 32
    """Stretching and bending explain the reading about equally well; sigma covers both."""
    OUTLIER = 64
    """A reading was left out because it jumped away and back faster than any tendon moves."""
    STUCK = 128
    """The ADC code has stayed the same for longer than noise allows: the tendon is left out."""
    IMPLAUSIBLE = 256
    """The length contradicts the other sensors and the balance of forces: the tendon is left out until they agree."""
    MISFIT = 512
    """The reading at rest is impossible for this tendon (wrong natural resistance or wiring); it is left out."""
    SHAKEN = 1024
    """The tendon's length swings faster than the sensor follows, and sigma is widened; or the robot is shaken, of which
    this sensor may show nothing."""

    def names(self) -> str:
        """Return the names of the flags that are set, joined by `|`, as in lengths.csv."""
        return "|".join((flag.name or "").lower() for flag in Flag if flag in self)

    @classmethod
    def of_names(cls, text: str) -> "Flag":
        """Return the flags from the text that `names` returns.

        Raises:
            ValueError: for a name that is not the name of a flag.
        """
        flags = cls(0)
        for name in filter(None, text.strip().split("|")):
            if name.upper() not in cls.__members__:
                raise ValueError("expected names of flags joined by |")
            flags |= cls[name.upper()]
        return flags


MOMENTARY = Flag.TOO_FAST | Flag.WARMING_UP | Flag.AMBIGUOUS | Flag.SHAKEN
"""Flags that describe one moment of a healthy sensor."""
SENSOR_FLAGS = ~MOMENTARY
"""Flags that describe a fault of the sensor."""
LEFT_OUT = Flag.MISSING | Flag.IMPLAUSIBLE | Flag.MISFIT
"""Flags with which a length is left out of the estimate. Of a frame with an `OUTLIER` other readings tell the length,
unless it is `MISSING`, too."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardReading:
    """One row of one board, as it arrived."""

    board: int
    """Index of the board in the trial."""
    host_s: float
    """Time of arrival on the host clock."""
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
    """The resistances of the sensors that are read together, at one instant, eq. (1)."""

    source: int
    """Index of the board, or 0 when one file holds all sensors."""
    t_s: float
    """Time of the measurement on the host clock."""
    arrival_s: float
    """Time of arrival at the host: no estimate may use the reading earlier."""
    tendon: NDArray[np.int64]
    """(channels,) the tendon of each sensor."""
    resistance_ohm: NDArray[np.float64]
    """(channels,) nan where there is no value."""
    sigma_ohm: NDArray[np.float64]
    """(channels,) standard deviation that the electronics alone cause."""
    flags: NDArray[np.int64]
    """(channels,) `Flag` bits."""


@dataclass(frozen=True, slots=True, eq=False)
class ResistanceFrame:
    """The resistances of all sensors at one instant of the output rate."""

    t_s: float
    resistance_ohm: NDArray[np.float64]
    """(tendons,) nan where there is no usable reading near t_s."""
    sigma_ohm: NDArray[np.float64]
    """(tendons,)"""
    flags: NDArray[np.int64]
    """(tendons,) `Flag` bits."""

    def first(self, count: int) -> "ResistanceFrame":
        """Return the frame of the first sensors alone."""
        if len(self.flags) == count:
            return self
        return ResistanceFrame(self.t_s, self.resistance_ohm[:count], self.sigma_ohm[:count], self.flags[:count])


@dataclass(frozen=True, slots=True)
class NaturalLengthReading:
    """The natural length of one tendon, as its motor tells it."""

    t_s: float
    """On the host clock."""
    tendon: int
    natural_length_m: float
    """L0 of string and strip together."""
    sigma_m: float
    """Standard deviation of its change since the rest, the same error for a long time: an offset."""


@dataclass(frozen=True, slots=True, eq=False)
class NaturalLengths:
    """The natural lengths of all tendons at one instant, where motors change some of them."""

    length_m: NDArray[np.float64]
    """(tendons,) L0 on the scale of trial.toml, which taring corrects."""
    sigma_m: NDArray[np.float64]
    """(tendons,) standard deviation of the change since the rest; 0 for a tendon without a motor."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorDrift:
    """The drift that was taken off the readings of one instant: the relative change of resistance without strain."""

    change: NDArray[np.float64]
    """(tendons,); of a tendon of known length all by which its reading has drifted."""
    sigma: NDArray[np.float64]
    """(tendons,) standard deviation of `change`."""
    per_change_m: NDArray[np.float64]
    """(tendons,) change of a stretched tendon's length for a relative change of resistance; 0 where it is known."""
    stretched_share: NDArray[np.float64] | float = 1.0
    """(tendons,) how far the length is that of a stretched tendon: what a bent one reads is not of this drift."""
    own_rate_per_s: float = 0.0
    """Standard deviation of the rate at which sensors drift apart; 0 while they do so no faster than in calibration,
    whose drift sigma_m contains."""
    references: int = 0
    """Number of the tendons of known length from which the common drift was computed."""
    board: NDArray[np.int64] | None = None
    """(tendons,) number of the board that reads each sensor, -1 for none; None where it is not known."""
    covariance_m2: NDArray[np.float64] | None = None
    """(tendons, tendons) covariance of the lengths' errors by the sensors' own drift, where it was estimated; sigma_m
    contains its diagonal."""

    @property
    def of_length_m(self) -> NDArray[np.float64]:
        """(tendons,) change of the length for a relative change of resistance."""
        return np.asarray(self.stretched_share * self.per_change_m)

    @property
    def is_shown(self) -> bool:
        """Whether references show the drift, or the lengths together, which contradict each other without it."""
        return self.references > 0 or self.covariance_m2 is not None

    @property
    def is_apart(self) -> bool:
        """Whether sensors drift apart, faster than in calibration or so far that lengths contradict each other."""
        return self.own_rate_per_s > 0 or self.covariance_m2 is not None


@dataclass(frozen=True, slots=True, eq=False)
class ModelError:
    """The error of lengths that comes from the sensor model, and that all sensors therefore share.

    It is that of one instant, or of several, with a leading axis of instants.
    """

    sigma_m: NDArray[np.float64]
    """(tendons,) standard deviation of the model's error, for a sensor that is not tared, times the probability that
    the tendon is stretched: the error of bent tendons is of another model."""
    tared_length_m: NDArray[np.float64]
    """(tendons,) l_0, the length at which each sensor was tared; nan for one that was not."""
    reach_m: NDArray[np.float64]
    """(tendons,) r, the change of length over which the model's error becomes another one."""
    after_motion: NDArray[np.float64]
    """(tendons,) m, the standard deviation of the model's error at l_0 because the strip was moved in the last half
    minute, over that of a sensor that is not tared."""

    @classmethod
    def stacked(cls, errors: Sequence["ModelError"]) -> "ModelError":
        """Return those of several instants."""
        return cls(
            np.array([error.sigma_m for error in errors]),
            np.array([error.tared_length_m for error in errors]),
            np.array([error.reach_m for error in errors]),
            np.array([error.after_motion for error in errors]),
        )

    def shared_m(self, length_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., tendons) s: the errors of the lengths l are b s with one b of standard deviation 1 for all.

        Strips that are stretched alike err alike. Taring takes the error off at l_0; away from there it grows, too long
        on one side where it is too short on the other, and after motion a part is there at l_0, too:
        s = sigma (tanh((l - l_0) / r) + m), between -sigma and sigma.
        """
        share = np.tanh((length_m - self.tared_length_m) / self.reach_m) + self.after_motion
        within = np.minimum(np.maximum(share, -1.0), 1.0)
        return self.sigma_m * np.where(np.isnan(self.tared_length_m), 1.0, within)


@dataclass(frozen=True, slots=True, eq=False)
class ModeReadings:
    """The lengths of all tendons at one instant as they are in each mode, of which the estimator may choose."""

    length_m: NDArray[np.float64]
    """(2, tendons) by `Mode`: if stretched, and if bent."""
    sigma_m: NDArray[np.float64]
    """(2, tendons) standard deviations of these."""
    bending_probability: NDArray[np.float64]
    """(tendons,) probability that the tendon is bent, by its reading alone."""


def is_impossible_length(length_m: NDArray[np.float64], natural_length_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (tendons,) whether no tendon of these natural lengths has such a length; False where it is nan."""
    return np.asarray((length_m < natural_length_m / MOST_STRETCH) | (length_m > natural_length_m * MOST_STRETCH))


def is_mode_uncertain(bending_probability: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (tendons,) whether both modes are considered, from the probabilities that tendons are bent."""
    return np.asarray((bending_probability > LEAST_PROBABILITY) & (bending_probability < 1 - LEAST_PROBABILITY))


@dataclass(frozen=True, slots=True, eq=False)
class FactorRows:
    """What a factor says of node positions, in rows; leading axes are frames."""

    residual: NDArray[np.float64]
    """(..., rows) what the positions predict minus what was read, in any unit; nan where nothing was read."""
    jacobian: NDArray[np.float64]
    """(..., rows, 3 nodes) its derivative by all coordinates, ordered by node."""
    sigma: NDArray[np.float64]
    """(..., rows) standard deviation of the reading, in the same unit; inf where nothing was read. A smaller one than
    1e-6 counts as 1e-6."""


class NodeFactor(Protocol):
    """A factor of one's own: what something other than a tendon's sensor says of the nodes of each frame."""

    def rows(self, t_s: NDArray[np.float64], node_position_m: NDArray[np.float64]) -> FactorRows:
        """Return what was read at some times against the positions of the nodes.

        The number of rows is always the same. A time may be asked for again, with other positions, and has the same
        readings then.

        Args:
            t_s: (...,) times of frames on the host clock; live, one time, and those of the last few frames again.
            node_position_m: (..., nodes, 3) positions at these times.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class TendonLengths:
    """The lengths of all tendons at one instant, eq. (4): the measurement that the factor graph takes."""

    t_s: float
    length_m: NDArray[np.float64]
    """(tendons,) nan where no length was measured."""
    sigma_m: NDArray[np.float64]
    """(tendons,) standard deviation of the measured length; inf where no length was measured."""
    mode: NDArray[np.int64]
    """(tendons,) `Mode`."""
    flags: NDArray[np.int64]
    """(tendons,) `Flag` bits."""
    rest_sigma_m: NDArray[np.float64] | float = 0.0
    """(tendons,) the part of sigma_m that comes from the rest shape, to which the sensors were tared."""
    lag_s: float = 0.0
    """Time by which the lengths lag behind t_s; an estimator that can wait may use later lengths instead."""
    drift: SensorDrift | None = None
    """The drift that was taken off; None for lengths that were not computed from resistance."""
    modes: ModeReadings | None = None
    """The lengths in each mode; None where every reading alone tells the mode of its tendon, and for lengths that were
    not computed from resistance."""
    aids: tuple[AidReading, ...] = ()
    """The readings of other sensors since the instant before, in order of time."""
    change_since_rest: NDArray[np.float64] | None = None
    """(tendons,) dR/R since the rest shape, of tared sensors; nan where none was read or tared, None for lengths that
    were not computed from resistance."""
    natural: NaturalLengths | None = None
    """The natural lengths at the instant that the lengths show, `lag_s` before t_s; None where no motor changes any."""
    of_strips: bool = True
    """Whether strips tell the lengths, which remember how they were moved."""
    factors: tuple[NodeFactor, ...] = ()
    """What else says something of the nodes at t_s; the same in all frames of a trial."""
    model_error: ModelError | None = None
    """The error of the sensor model, which sigma_m contains; None for lengths of which it is not known."""
    rest_in_doubt: bool = False
    """Whether readings until now do not fit the rest shape to which the sensors were tared, or moved meanwhile."""

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(tendons,) where there is a measured length with a finite sigma."""
        return np.isfinite(self.length_m) & np.isfinite(self.sigma_m)


@dataclass(frozen=True, slots=True, eq=False)
class RestLengths:
    """The tendon lengths while the structure stands unloaded at its rest shape."""

    seconds: float
    """How long the structure stands at its rest shape at the start of the trial."""
    length_m: NDArray[np.float64]
    """(tendons,) nan where it is not known."""
    sigma_m: NDArray[np.float64]
    """(tendons,) standard deviation of length_m."""

    @property
    def is_read(self) -> NDArray[np.bool_]:
        """(tendons,) which lengths are known."""
        return np.isfinite(self.length_m)


OtherReading = AidReading | NaturalLengthReading
"""What another sensor or a motor tells."""
RecordedReading = BoardReading | OtherReading
"""What a recording holds."""
Reading = RecordedReading | ResistanceReading | TendonLengths
"""One measurement of a trial: a row of counts, a reading of resistance, lengths, or what another sensor or a motor
tells."""


def arrival_s(reading: Reading) -> float:
    """Return when a reading reached the host; that of an aid counts as its time."""
    if isinstance(reading, BoardReading):
        return reading.host_s
    return reading.arrival_s if isinstance(reading, ResistanceReading) else reading.t_s
