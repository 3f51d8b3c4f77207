"""Conversion of the boards' rows to readings of resistance, by the voltage divider and each board's clock."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..values.errors import InputError
from ..values.readings import BoardReading, Flag, ResistanceReading
from ..values.stamps import check_stamp
from .clock import BoardClock, ClockCounts, ClockSettings
from .divider import Divider


class CountConverter:
    """Converts rows of counts to readings of resistance, eq. (1), with their times on the host clock."""

    def __init__(
        self, divider: Divider, tendons_of_board: Sequence[NDArray[np.int64]], settings: ClockSettings
    ) -> None:
        self._divider = divider
        self._tendons = tendons_of_board
        self._clocks = [BoardClock(settings) for _ in tendons_of_board]

    @property
    def counts(self) -> list[ClockCounts]:
        """The numbers of rows and irregular events of each board so far."""
        return [clock.counts for clock in self._clocks]

    def warnings(self) -> dict[str, str]:
        """Return what looks wrong of the boards' clocks, by the clock."""
        found = {f"clock of board {board}": clock.warning() for board, clock in enumerate(self._clocks)}
        return {clock: text for clock, text in found.items() if text}

    def reading(self, row: BoardReading) -> ResistanceReading | None:
        """Return the reading of a row; None for a row that came late or twice or does not follow the one before.

        Raises:
            InputError: when there is no such board, it has another number of channels, counts are no integers, its
                counters do not count rows and microseconds, or the host's clock tells no time.
        """
        if row.board not in range(len(self._tendons)):
            raise InputError(f"board {row.board!r}: expected one from 0 to {len(self._tendons) - 1}")
        if np.shape(row.counts) != self._tendons[row.board].shape:
            channels = len(self._tendons[row.board])
            raise InputError(f"board {row.board}: expected counts of {channels} channels, got {np.shape(row.counts)}")
        if not (isinstance(row.counts, np.ndarray) and np.issubdtype(row.counts.dtype, np.integer)):
            got = row.counts.dtype if isinstance(row.counts, np.ndarray) else type(row.counts).__name__
            raise InputError(f"board {row.board}: expected counts as an array of integers, got {got}")
        check_stamp(f"board {row.board}: host_s", row.host_s)
        clock = self._clocks[row.board]
        t_s = clock.time_s(row)
        clock.check_counters(row.board)
        if t_s is None:
            return None
        possible = (row.counts >= 0) & (row.counts < self._divider.codes)
        saturated = possible & self._divider.saturated(row.counts)
        value = possible & ~saturated
        resistance_ohm = self._divider.resistance_ohm(np.where(value, row.counts, 1))
        return ResistanceReading(
            source=row.board,
            t_s=t_s,
            arrival_s=row.host_s,
            tendon=self._tendons[row.board],
            resistance_ohm=np.where(value, resistance_ohm, np.nan),
            sigma_ohm=np.where(value, self._divider.sigma_ohm(resistance_ohm), np.nan),
            flags=np.where(saturated, int(Flag.SATURATED), np.where(possible, 0, int(Flag.OUT_OF_RANGE))),
        )
