"""The front end of a sensor model that another package brings: dR/R and time in; strain, sigma and mode out.

The model knows nothing of the structure. The front end gives it the relative change of each sensor's resistance, tares
the strain that it returns with the known strain e_0 at the rest shape, and makes lengths of it:

    e = e_model + e_0 - mean of e_model at rest,   L = (1 + e) L_0
    sigma(e)^2 = sigma_model^2 + spread of e_model at rest^2 + sigma(e_0)^2

The spread contains noise, and motion of the structure, which the mean would hide.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .sensor.stillness import MOVING_TENDONS
from .sensor.taring import MOVED_STRAIN
from .values.errors import InputError
from .values.readings import Flag, Mode, ResistanceFrame, RestLengths, TendonLengths, is_impossible_length
from .values.stamps import RestClock


@dataclass(frozen=True, slots=True, eq=False)
class StrainReading:
    """What a sensor model tells of all sensors at one instant."""

    strain: NDArray[np.float64]
    """(tendons,) L / L_0 - 1; nan where it tells none."""
    sigma: NDArray[np.float64]
    """(tendons,) standard deviation of strain."""
    mode: NDArray[np.int64]
    """(tendons,) `Mode`."""


class StrainModel(Protocol):
    """A sensor model that is asked frame by frame, and may remember the frames before."""

    def step(self, t_s: float, change: NDArray[np.float64]) -> StrainReading:
        """Return strain, sigma and mode of all tendons.

        Args:
            t_s: time of the frame, later than all before.
            change: (tendons,) dR/R; nan where there is no usable reading.
        """
        ...


StrainModelFactory = Callable[[int], StrainModel]
"""What an entry point of the group `tensegraph.sensor_models` names: it makes the model of a number of tendons."""


class StrainFrontEnd:
    """Converts frames of resistance to frames of length with a `StrainModel`, one after another."""

    def __init__(
        self,
        make: StrainModelFactory,
        natural_resistance_ohm: NDArray[np.float64],
        natural_length_m: NDArray[np.float64],
        rest: RestLengths | None,
    ) -> None:
        count = len(natural_length_m)
        self._model = make(count)
        self._R0 = natural_resistance_ohm
        self._L0 = natural_length_m
        self._rest_clock = RestClock(rest.seconds if rest else 0.0)
        self._rest_strain = rest.length_m / natural_length_m - 1 if rest else np.zeros(count)
        self._rest_sigma = rest.sigma_m / natural_length_m if rest else np.zeros(count)
        self._count = np.zeros(count)
        self._mean = np.zeros(count)
        self._squares = np.zeros(count)
        self.exchanged: list[tuple[int, int]] = []
        """No pairs: what a reading at rest would have to be is the model's knowledge."""
        self.misfits_at_rest = False
        """Unknown, for the same reason."""

    def lengths(self, frames: Sequence[ResistanceFrame]) -> list[TendonLengths]:
        """Return the lengths in more frames.

        Raises:
            InputError: when the model returns arrays of another form, or a mode that is none.
        """
        return [self._lengths_of(frame) for frame in frames]

    def _lengths_of(self, frame: ResistanceFrame) -> TendonLengths:
        frame = frame.first(len(self._L0))
        change = frame.resistance_ohm / self._R0 - 1
        told = _checked(self._model.step(frame.t_s, change), len(self._L0))
        used = np.isfinite(change) & np.isfinite(told.strain) & np.isfinite(told.sigma) & (told.sigma > 0)
        self._tare(frame.t_s, told.strain, used)
        tared = self._count > 0
        strain = told.strain + np.where(tared, self._rest_strain - self._mean, 0.0)
        possible = used & ~is_impossible_length((1 + strain) * self._L0, self._L0)
        rest_sigma = np.where(tared, self._rest_sigma, 0.0)
        sigma = np.sqrt(told.sigma**2 + self._spread**2 + rest_sigma**2)
        flags = frame.flags | np.where(possible, 0, int(Flag.MISSING))
        return TendonLengths(
            t_s=frame.t_s,
            length_m=np.where(possible, (1 + strain) * self._L0, np.nan),
            sigma_m=np.where(possible, sigma * self._L0, np.inf),
            mode=told.mode,
            flags=flags | np.where(used & ~possible, int(Flag.OUT_OF_RANGE), 0),
            rest_sigma_m=np.where(possible, rest_sigma * self._L0, 0.0),
            rest_in_doubt=self.moved_at_rest,
        )

    @property
    def moved_at_rest(self) -> bool:
        """Whether the structure moved while its sensors were tared; sigma is then widened."""
        return bool((self._spread > MOVED_STRAIN).sum() >= MOVING_TENDONS)

    @property
    def _spread(self) -> NDArray[np.float64]:
        """(tendons,) standard deviation of the model's strain while the structure rested."""
        return np.sqrt(self._squares / np.maximum(self._count, 1))

    def _tare(self, t_s: float, strain: NDArray[np.float64], used: NDArray[np.bool_]) -> None:
        """Add strain to mean and squares about it (Welford), while the structure rests from the first frame on."""
        self._rest_clock.count_frame(t_s)
        if not self._rest_clock.is_at_rest(t_s):
            return
        self._count += used
        before = np.where(used, strain - self._mean, 0.0)
        self._mean += before / np.maximum(self._count, 1)
        self._squares += before * np.where(used, strain - self._mean, 0.0)


def _checked(told: Any, count: int) -> StrainReading:
    """Return what a model told, as arrays of the right form."""
    if not isinstance(told, StrainReading):
        raise InputError(f"sensor model: expected a StrainReading from step, got {type(told).__name__}")
    reading = StrainReading(
        np.asarray(told.strain, dtype=np.float64),
        np.asarray(told.sigma, dtype=np.float64),
        np.asarray(told.mode, dtype=np.int64),
    )
    for name in ("strain", "sigma", "mode"):
        shape = getattr(reading, name).shape
        if shape != (count,):
            raise InputError(f"sensor model: {name}: expected {count} numbers, one of each tendon, got shape {shape}")
    if not np.isin(reading.mode, [int(mode) for mode in Mode]).all():
        raise InputError(f"sensor model: mode: expected {', '.join(map(str, map(int, Mode)))}, got {reading.mode}")
    return reading
