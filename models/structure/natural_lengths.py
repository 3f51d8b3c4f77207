"""Natural lengths that motors change, and the lengths of tendons that are part string and part sensing strip.

A motor winds a string that does not stretch, in series with the strip that the sensor is. Of the natural length L0(t)
of both together, the strip's own part L_s never changes. With the strain e that the sensor reads,

    l = (L0(t) - L_s) + L_s (1 + e),     T = k (l - L0(t))

so that winding by itself changes the length of the string, and the strain only by what the structure gives way.

Motors tell L0 in rows of their own, of which only the change since the rest counts: there L0 is that of trial.toml, and
the sensors are tared. Between two rows L0 is on the straight line. After the last row it is held, and sigma grows by
the distance that the motor would go on at its last speed. After `MAX_SILENCE_S` nothing is known of it.
"""

from bisect import insort
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..values.errors import InputError
from ..values.readings import (
    BENDING,
    STRETCHING,
    Flag,
    NaturalLengthReading,
    NaturalLengths,
    RestLengths,
    TendonLengths,
)
from ..values.stamps import RestClock
from .structure import Structure

MAX_SILENCE_S = 0.5
"""Time without rows of a motor after which the natural length of its tendon is unknown."""
UNKNOWN_SHARE = 0.2
"""Standard deviation of an unknown natural length, as a share of it: no force of the tendon counts then."""
FASTEST_M_PER_S = 0.5
"""Speed that no motor of such a robot reaches; a row that needs more since the last one is absurd."""
ABSURD_SIGMA = 5.0
"""Number of standard deviations by which a row may be beyond what is possible."""


@dataclass(frozen=True, slots=True, eq=False)
class Motors:
    """The tendons that the motors of one recording wind."""

    tendons: tuple[int, ...]
    strip_length_m: float
    """L_s, the natural length of the strip in each of these tendons."""

    def check(self, structure: Structure) -> None:
        """Refuse motors that cannot be on a structure.

        Raises:
            InputError: naming the key and the tendon.
        """
        count = len(structure.tendons)
        if not self.tendons or len(set(self.tendons)) < len(self.tendons):
            raise InputError(f"tendons: expected different tendons, at least one, got {list(self.tendons)}")
        for tendon in self.tendons:
            if not 0 <= tendon < count:
                raise InputError(f"tendons: expected tendons from 0 to {count - 1}, got {tendon}")
            natural_m = structure.natural_length_m[tendon]
            if self.strip_length_m > natural_m:
                raise InputError(
                    f"strip_length_m: expected at most the natural length of tendon {tendon}, {natural_m:g} m, "
                    f"got {self.strip_length_m:g}"
                )


def strip_length_m(structure: Structure, motors: Sequence[Motors]) -> NDArray[np.float64]:
    """Return (tendons,) the natural length of each strip: the tendon's, where no motor winds a string."""
    length_m = structure.natural_length_m.copy()
    for one in motors:
        length_m[list(one.tendons)] = one.strip_length_m
    return length_m


class Winding:
    """Follows the natural lengths of all tendons, and makes lengths of tendons from those of strips.

    Args:
        structure: with the natural lengths at rest.
        motors: what winds; without any, lengths stay as they are.
        rest_seconds: how long the structure stands at rest, from the first frame.
        reads_strips: whether lengths are those of the strips; else they are the distances between two nodes.
    """

    def __init__(
        self, structure: Structure, motors: Sequence[Motors], rest_seconds: float, *, reads_strips: bool
    ) -> None:
        self._natural_m = structure.natural_length_m
        self._strip_m = strip_length_m(structure, motors)
        self._rest_clock = RestClock(rest_seconds)
        self._reads_strips = reads_strips
        self._motors = {
            tendon: _Motor(float(structure.natural_length_m[tendon]), one.strip_length_m)
            for one in motors
            for tendon in one.tendons
        }

    def strips(self, rest: RestLengths) -> RestLengths:
        """Return the lengths of the strips at rest, from those of whole tendons."""
        return replace(rest, length_m=rest.length_m - (self._natural_m - self._strip_m))

    def add(self, reading: NaturalLengthReading) -> None:
        """Add one row of a motor; of one tendon, stamps increase."""
        self._motors[reading.tendon].add(reading, resting=self._rest_clock.is_at_rest(reading.t_s))

    def applied(self, lengths: TendonLengths) -> TendonLengths:
        """Return the lengths of whole tendons at one instant, with the natural lengths that they show."""
        if not self._motors:
            return lengths
        self._rest_clock.count_frame(lengths.t_s)
        natural, unknown = self._at(lengths.t_s - lengths.lag_s)
        lengths = replace(lengths, natural=natural)
        if not self._reads_strips:
            bent = lengths.length_m < natural.length_m
            return replace(lengths, mode=np.where(bent, BENDING, STRETCHING))
        string_m = natural.length_m - self._strip_m
        modes = lengths.modes
        if modes is not None:
            sigma_m = np.hypot(modes.sigma_m, natural.sigma_m)
            modes = replace(modes, length_m=modes.length_m + string_m, sigma_m=sigma_m)
        error = lengths.model_error
        if error is not None:
            error = replace(error, tared_length_m=error.tared_length_m + string_m)
        return replace(
            lengths,
            length_m=np.where(unknown, np.nan, lengths.length_m + string_m),
            sigma_m=np.where(unknown, np.inf, np.hypot(lengths.sigma_m, natural.sigma_m)),
            rest_sigma_m=np.where(unknown, 0.0, lengths.rest_sigma_m),
            flags=lengths.flags | np.where(unknown, int(Flag.MISSING), 0),
            modes=modes,
            model_error=error,
        )

    def counts(self) -> dict[str, int]:
        """Return the numbers of rows that were left out or are unlike trial.toml, and of frames without rows."""
        counts: dict[str, int] = {}
        for tendon, motor in self._motors.items():
            counts[f"motor of tendon {tendon}: absurd rows"] = motor.absurd
            counts[f"motor of tendon {tendon}: rows at rest unlike natural_length_m"] = motor.unlike
            counts[f"motor of tendon {tendon}: frames without its rows"] = motor.unknown
        return counts

    def _at(self, t_s: float) -> tuple[NaturalLengths, NDArray[np.bool_]]:
        """Return the natural lengths at a time, later than those before, and (tendons,) which are unknown."""
        natural = NaturalLengths(self._natural_m.copy(), np.zeros(len(self._natural_m)))
        unknown = np.zeros(len(self._natural_m), dtype=np.bool_)
        for tendon, motor in self._motors.items():
            known = motor.at(t_s)
            if known is not None:
                natural.length_m[tendon], natural.sigma_m[tendon] = known
            elif not self._rest_clock.is_at_rest(t_s):
                unknown[tendon] = True
                motor.unknown += 1
                natural.sigma_m[tendon] = UNKNOWN_SHARE * self._natural_m[tendon]
        return natural, unknown


@dataclass(slots=True)
class _Motor:
    """The rows of one tendon, as far as they are needed."""

    natural_m: float
    """L0 at rest."""
    strip_m: float
    """L_s"""
    rows: deque[NaturalLengthReading] = field(default_factory=deque)
    """The last two before the time that was asked for last, and all later ones."""
    at_rest_m: list[float] = field(default_factory=list)
    """Natural lengths that were read at rest, sorted."""
    absurd: int = 0
    """Number of rows that were left out."""
    unlike: int = 0
    """Number of rows at rest that are unlike L0."""
    unknown: int = 0
    """Number of frames in which nothing was known."""

    @property
    def shift_m(self) -> float:
        """What is added to a row: L0 minus the median of what was read at rest."""
        return self.natural_m - self.at_rest_m[len(self.at_rest_m) // 2] if self.at_rest_m else 0.0

    def add(self, row: NaturalLengthReading, *, resting: bool) -> None:
        """Add a row, unless it is absurd."""
        tolerance_m = ABSURD_SIGMA * row.sigma_m
        read_m = row.natural_length_m
        absurd = not resting and read_m + self.shift_m < self.strip_m - tolerance_m
        if self.rows:
            last = self.rows[-1]
            absurd |= abs(read_m - last.natural_length_m) > FASTEST_M_PER_S * (row.t_s - last.t_s) + tolerance_m
        if absurd:
            self.absurd += 1
            return
        self.rows.append(row)
        if resting:
            insort(self.at_rest_m, read_m)
            self.unlike += abs(read_m - self.natural_m) > tolerance_m

    def at(self, t_s: float) -> tuple[float, float] | None:
        """Return the natural length at a time and its sigma; None where the rows around it are too far away."""
        while len(self.rows) > 2 and self.rows[2].t_s <= t_s:
            self.rows.popleft()
        before = [row for row in self.rows if row.t_s <= t_s]
        after = next((row for row in self.rows if row.t_s > t_s), None)
        found: tuple[float, float] | None = None
        if before:
            found = _between(before[-1], after, t_s) or _held(before, t_s)
        elif after is not None and after.t_s - t_s <= MAX_SILENCE_S:
            found = after.natural_length_m, after.sigma_m
        return None if found is None else (found[0] + self.shift_m, found[1])


def _between(last: NaturalLengthReading, after: NaturalLengthReading | None, t_s: float) -> tuple[float, float] | None:
    """Return the natural length on the line between two rows, and its sigma; None where they are too far apart."""
    if after is None or after.t_s - last.t_s > MAX_SILENCE_S:
        return None
    share = (t_s - last.t_s) / (after.t_s - last.t_s)
    length_m = (1 - share) * last.natural_length_m + share * after.natural_length_m
    return length_m, (1 - share) * last.sigma_m + share * after.sigma_m


def _held(before: Sequence[NaturalLengthReading], t_s: float) -> tuple[float, float] | None:
    """Return the natural length of the last row, with a sigma that grows; None where the row is too old."""
    last = before[-1]
    age_s = t_s - last.t_s
    if age_s > MAX_SILENCE_S:
        return None
    gone_on_m = 0.0
    if len(before) > 1:
        earlier = before[-2]
        gone_on_m = (last.natural_length_m - earlier.natural_length_m) / (last.t_s - earlier.t_s) * age_s
    return last.natural_length_m, float(np.hypot(last.sigma_m, gone_on_m))
