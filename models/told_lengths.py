"""Lengths that are told, as of sensors of one's own: each is used as far as it agrees with itself.

Left out are lengths that no tendon has or that are longer than a way over other members (`WaysAround`), values that
jump (`JumpGate`), or stay where they have jumped to alone (`LoneJumps`), and those of a sensor that repeats itself for
longer than chance allows (`StuckGate`) while other lengths change: one that is read in steps repeats itself wherever
the structure holds still. Rows that repeat the row before are none, as of sensors that are slower than the file, and
say nothing of one sensor.

At rest a length does not change, or slowly. Its variance is that of successive values m_k that differ, whatever drifts
slowly (von Neumann):

    s^2 = sum (m_k - m_{k-1})^2 / (2 n)

If it is larger than chance allows for the sigma that is told, sigma counts s / sigma times from then on.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import shortest_path

from .sensor.gate import GateSettings, JumpGate, StuckGate
from .sensor.stillness import MOVING_TENDONS
from .sensor.taring import MOVED_STRAIN
from .structure.structure import Structure
from .values.chi_squared import chi_squared_quantile
from .values.errors import InputError
from .values.readings import Flag, RestLengths, TendonLengths, is_impossible_length
from .values.stamps import SHORTEST_STEP_S, RestClock, check_stamp, is_later
from .values.time_series import mean_over_frames

CHANCE = 1e-6
"""Probability that the values of a sensor whose sigma is right scatter as much as is taken for a wrong sigma."""
DIFFERENCES_SHARE = 2 / 3
"""Degrees of freedom of the variance over the number of differences, as successive ones share a value."""
UNSTATED_SHARE = 0.01
"""Share of a tendon above which the sigma of lengths that are told without one is named. At a quarter of its size,
where it is 2 %, press_01 with exact lengths is 1.5 mm off live, and 0.5 mm with sigmas; at a tenth the press is missed.
"""
LASTING_M = 0.0003
"""Standard deviation of the error that all readings of a length share, as of where on its node it ends."""
MOST_INDEPENDENT = 25
"""Largest number of readings whose errors count as independent of each other."""
REST_PARTS = 4
"""Number of parts of the rest whose mean lengths are compared."""
CHANGED_SIGMA = 3.0
"""Standard deviations by which a length has changed; several have to."""
MOVED_SHARE = 0.1
"""Share of the way of a length that has jumped, by which another one has to change for a node to have moved so. When a
slack structure collapses, the far end of a rod that stands on an anchor moves along one tendon, and others change by
0.18 to 0.26 of its way."""
LONGER = 1.1
"""Ratio of a length to the shortest way over other members, above which no structure has it."""


def lengths_at_rest(frames: Sequence[TendonLengths], seconds: float) -> tuple[RestLengths, bool]:
    """Return the mean lengths at rest, and whether the structure moved.

    sigma^2 = sigma_reading^2 / n + `LASTING_M`^2 with n up to `MOST_INDEPENDENT`, nan where nothing was read. If the
    structure moved, half the range of the means over parts of the rest is added in quadrature.

    Args:
        frames: of the rest, at least one.
        seconds: how long the rest is.
    """
    read = np.array([lengths.usable for lengths in frames])
    length_m = np.where(read, [lengths.length_m for lengths in frames], np.nan)
    sigma_m = mean_over_frames(np.where(read, [lengths.sigma_m for lengths in frames], np.nan))
    parts_m = np.array([mean_over_frames(part) for part in np.array_split(length_m, REST_PARTS) if len(part)])
    range_m = np.fmax.reduce(parts_m) - np.fmin.reduce(parts_m)
    count = read.sum(axis=0)
    of_part_m = sigma_m * np.sqrt(REST_PARTS / np.maximum(count, REST_PARTS))
    mean_m = mean_over_frames(length_m)
    moved = bool((range_m > MOVED_STRAIN * mean_m + CHANGED_SIGMA * of_part_m).sum() >= MOVING_TENDONS)
    noise_m = sigma_m / np.sqrt(np.clip(count, 1, MOST_INDEPENDENT))
    return RestLengths(
        seconds=seconds,
        length_m=mean_m,
        sigma_m=np.sqrt(noise_m**2 + LASTING_M**2 + (0.5 * range_m if moved else np.zeros_like(range_m)) ** 2),
    ), moved


class WaysAround:
    """Finds tendons that would be longer than a way from one of their ends to the other over other members.

    Of no structure a straight line is longer than any other way: an encoder that reads 0.66 m, the end of its range,
    for a tendon whose ends a rod of 0.3 m and another tendon join, turned the structure inside out.
    """

    def __init__(self, structure: Structure, full_m: NDArray[np.float64]) -> None:
        """Begin; a tendon counts as long as it is read, or (tendons,) full, whatever is longer."""
        self._structure = structure
        self._full_m = full_m

    def too_long(self, length_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (tendons,) whether lengths are too long; nan where none is read, which other ways do not use."""
        found = np.zeros(len(length_m), dtype=np.bool_)
        tendon_m = np.maximum(length_m, self._full_m)
        for tendon in map(int, np.flatnonzero(length_m > LONGER * self._shortest_m)):
            found[tendon] = length_m[tendon] > LONGER * self._way_m(tendon, tendon_m)
        return found

    @cached_property
    def _shortest_m(self) -> NDArray[np.float64]:
        """(tendons,) the shortest way around each tendon, if no other is longer than `full_m`."""
        return np.array([self._way_m(tendon, self._full_m) for tendon in range(len(self._full_m))])

    def _way_m(self, tendon: int, tendon_m: NDArray[np.float64]) -> float:
        """Return the shortest way around a tendon over rods and (tendons,) other tendons; inf if there is none."""
        structure = self._structure
        way_m = np.zeros((structure.node_count, structure.node_count))
        others = np.flatnonzero(np.isfinite(tendon_m) & (np.arange(len(tendon_m)) != tendon))
        way_m[tuple(structure.rods.T)] = structure.rod_length_m
        way_m[tuple(structure.tendons[others].T)] = tendon_m[others]
        start, end = structure.tendons[tendon]
        return float(shortest_path(way_m, directed=False, indices=start)[end])


class LoneJumps:
    """Finds lengths that have jumped, and stay there, while no other has changed: a node takes all its tendons along.

    They are left out until they are nearer to where they were before than to where they were last.
    """

    def __init__(self, count: int) -> None:
        self._is_jumping = np.zeros(count, dtype=np.bool_)
        self._is_lone = np.zeros(count, dtype=np.bool_)
        self._good_m = np.full(count, np.nan)
        self._before_m = np.full((count, count), np.nan)
        """(tendons, tendons) all lengths before each has jumped."""
        self._jumped_m = np.full(count, np.nan)

    def lone(
        self, length_m: NDArray[np.float64], jumped: NDArray[np.bool_], sigma_m: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return (tendons,) which lengths of one more row have jumped alone.

        Args:
            length_m: (tendons,) the lengths; nan where none is read.
            jumped: (tendons,) which of them the gate takes for outliers.
            sigma_m: (tendons,) their standard deviations.
        """
        read = np.isfinite(length_m)
        if not (jumped | self._is_jumping | self._is_lone).any():
            self._good_m = np.where(read, length_m, self._good_m)
            return self._is_lone
        begins = jumped & ~self._is_jumping & ~self._is_lone
        self._before_m[begins] = self._good_m
        own_m = np.diag(self._before_m)
        way_m = np.abs(length_m - own_m)
        stays = read & ~(way_m < np.abs(length_m - self._jumped_m))
        ends = self._is_jumping & read & ~jumped
        others_m = np.abs(length_m - self._before_m) - CHANGED_SIGMA * sigma_m
        np.fill_diagonal(others_m, np.nan)
        alone = np.isfinite(others_m).sum(axis=1) >= MOVING_TENDONS
        alone &= np.fmax.reduce(others_m, axis=1, initial=0.0) < MOVED_SHARE * way_m
        self._is_lone = np.where(read, (self._is_lone | (ends & alone)) & stays, self._is_lone)
        self._is_jumping = np.where(read, jumped, self._is_jumping)
        away = jumped | self._is_lone
        self._jumped_m = np.where(read & away, length_m, self._jumped_m)
        self._good_m = np.where(read & ~away, length_m, self._good_m)
        return self._is_lone & read


class ToldLengths:
    """Checks one row of lengths after the other."""

    def __init__(
        self,
        settings: GateSettings,
        structure: Structure,
        full_m: NDArray[np.float64],
        rest_seconds: float,
        unstated_m: float,
    ) -> None:
        """Begin before the first row.

        Args:
            settings: when a value is left out.
            structure: of which these are the lengths.
            full_m: (tendons,) the length to which strain is relative.
            rest_seconds: how long the structure rests from the first row on.
            unstated_m: standard deviation of a length that is told without one.
        """
        self._full_m = full_m
        self._ways = WaysAround(structure, full_m)
        self._rest_clock = RestClock(rest_seconds)
        self._unstated_m = unstated_m
        self._is_unstated = np.zeros(len(full_m), dtype=np.bool_)
        count = len(full_m)
        self._jumps = JumpGate(settings, count)
        self._lone_jumps = LoneJumps(count)
        self._repeats = StuckGate(settings, count)
        self._last_s = -np.inf
        self._late_rows = 0
        self._last_m = np.full(count, np.nan)
        self._since_m = np.full((count, count), np.nan)
        """(tendons, tendons) the row with which the present value of each tendon began."""
        self._is_stuck = np.zeros(count, dtype=np.bool_)
        self._differences = np.zeros(count)
        self._squares = np.zeros(count)
        self._scale = np.ones(count)

    def checked(self, lengths: TendonLengths) -> TendonLengths | None:
        """Return the lengths of one more row, with a sigma each, and without those that are left out.

        A row that is not `SHORTEST_STEP_S` later than the one before is left out, and None is returned.

        Raises:
            InputError: for a row without a length, a sigma above 0, or nan, a mode and flags of each tendon, or without
                a stamp.
        """
        check_stamp("t_s of lengths", lengths.t_s)
        if not is_later(lengths.t_s, self._last_s):
            self._late_rows += 1
            return None
        self._check_numbers(lengths)
        self._last_s = lengths.t_s
        self._rest_clock.count_frame(lengths.t_s)
        impossible = is_impossible_length(lengths.length_m, self._full_m) | self._ways.too_long(lengths.length_m)
        length_m = np.where(impossible, np.nan, lengths.length_m)
        is_unstated = np.isnan(lengths.sigma_m)
        self._is_unstated |= is_unstated & np.isfinite(lengths.length_m)
        sigma_m = np.where(is_unstated, self._unstated_m, lengths.sigma_m)
        counted_m = self._scale * sigma_m
        jumped = self._jumps.outliers(lengths.t_s, length_m / self._full_m, counted_m / self._full_m)
        jumped = jumped | self._lone_jumps.lone(length_m, jumped, counted_m)
        length_m = np.where(jumped, np.nan, length_m)
        stuck = self._stuck(lengths.t_s, length_m, counted_m)
        if self._rest_clock.is_at_rest(lengths.t_s):
            self._rest(length_m, sigma_m)
        self._last_m = np.where(np.isnan(length_m), self._last_m, length_m)
        length_m = np.where(stuck, np.nan, length_m)
        flags = np.where(jumped, int(Flag.OUTLIER), 0) | np.where(stuck, int(Flag.STUCK), 0)
        return replace(
            lengths,
            length_m=length_m,
            sigma_m=np.where(np.isnan(length_m), np.inf, self._scale * sigma_m),
            flags=lengths.flags | flags | np.where(impossible, int(Flag.OUT_OF_RANGE), 0),
        )

    def warnings(self) -> dict[str, str]:
        """Return of each tendon whose sigma counts more than it was told why that is so, and what else looks wrong.

        These are rows that are left out, and a sigma that nobody has told and that is large for the tendons.
        """
        told = {}
        if self._late_rows:
            told["lengths"] = (
                f"{self._late_rows} rows left out, which are not {SHORTEST_STEP_S:g} s later than the one before"
            )
        share = self._unstated_m / np.median(self._full_m[self._is_unstated]) if self._is_unstated.any() else 0.0
        if share > UNSTATED_SHARE:
            told["sigma of lengths"] = (
                f"none is given: noise.unstated_m, {1e3 * self._unstated_m:g} mm, counts, {share:.1%} of a tendon: "
                "what moves lengths by less may be missed"
            )
        return told | {
            f"tendon {e}": f"at rest it scatters by {self._scale[e]:.1f} times its sigma, which is widened by as much"
            for e in np.flatnonzero(self._scale > 1)
        }

    def _check_numbers(self, lengths: TendonLengths) -> None:
        tendons = self._full_m.shape
        shapes = [getattr(value, "shape", "no array") for value in (lengths.length_m, lengths.sigma_m)]
        if shapes != [tendons, tendons]:
            got = f"shapes {shapes[0]} and {shapes[1]}"
            raise InputError(f"lengths at {lengths.t_s:g} s: expected {tendons[0]} lengths and sigmas, got {got}")
        for name, value in (("modes", lengths.mode), ("flags", lengths.flags)):
            if getattr(value, "shape", "no array") != tendons or not np.issubdtype(value.dtype, np.integer):
                got = f"{value.dtype} of shape {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
                raise InputError(f"lengths at {lengths.t_s:g} s: expected {tendons[0]} {name}, integers, got {got}")
        if (lengths.sigma_m <= 0).any():
            raise InputError(f"lengths at {lengths.t_s:g} s: expected sigmas above 0, got {lengths.sigma_m.min():g}")

    def _stuck(self, t_s: float, length_m: NDArray[np.float64], sigma_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (tendons,) whose values are equal for longer than chance allows, while others change."""
        told = np.isfinite(length_m)
        same = told & (length_m == self._last_m)
        if same[told].all():
            return self._is_stuck & told
        self._since_m[told & ~same] = length_m
        changed = np.abs(length_m - self._since_m) > CHANGED_SIGMA * sigma_m
        repeats = self._repeats.stuck(t_s, length_m) & (changed.sum(axis=1) >= MOVING_TENDONS)
        self._is_stuck = same & (self._is_stuck | repeats)
        return self._is_stuck

    def _rest(self, length_m: NDArray[np.float64], sigma_m: NDArray[np.float64]) -> None:
        """Add the differences of one more row at rest from the row before."""
        differs = np.isfinite(length_m) & np.isfinite(self._last_m) & (length_m != self._last_m)
        self._differences += differs
        self._squares += np.where(differs, (length_m - self._last_m) ** 2 / (2 * sigma_m**2), 0.0)
        degrees = np.maximum(DIFFERENCES_SHARE * self._differences, 1)
        chance = chi_squared_quantile(1 - CHANCE, degrees)
        is_wrong = DIFFERENCES_SHARE * self._squares > chance
        self._scale = np.where(is_wrong, np.sqrt(self._squares / np.maximum(self._differences, 1)), 1.0)
