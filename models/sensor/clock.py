"""Conversion of a board's clock to the host's clock, from past rows only.

A row with the board's time stamp d reaches the host at h = a + b d + delay, delay >= 0. So the line a + b d lies below
all points (d, h), and the best such line contains an edge of their lower convex hull. (Least squares would be late by
the mean delay: 3.5 ms instead of 0.001 ms, for exponential jitter of 3 ms.)
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..values.errors import InputError
from ..values.readings import BoardReading
from ..values.tables import NotNegative, Positive

WRAP_US = 1 << 32
"""Number of microseconds after which a board's clock begins anew."""
SEQ_WRAP = 1 << 16
"""Number of rows after which a board's counter begins anew."""
ROW_PERIOD_TOLERANCE = 0.1
"""Largest difference of the time between two rows from the usual one, as a share of it, at which both belong to one run
of the board."""
HOST_TOLERANCE_S = 1.0
"""Largest difference between the host's clock and a board's at which both may tell the same."""
UNIT_SPAN_S = 10.0
"""Time on a board's clock after which the host's is compared with it: rows may wait, and come in a burst."""
HOST_SPAN_S = 2.0
"""Time on the host's clock after which a board's is compared with it, which goes on while rows wait."""
SLOWEST_CLOCK = 0.1
"""Ratio of one clock to the other below which one of them counts in another unit."""
RATE_SPAN_S = 20.0
"""Time on a board's clock from which its rate is known well enough to be told."""
UNCOUNTED_ROWS = 100
"""Number of rows after which a board is refused of which none followed the first."""


@dataclass(frozen=True, slots=True)
class ClockSettings:
    """What is known of the boards' clocks and of the transmission to the host."""

    minimum_delay_s: NotNegative = 0.002
    """The part of the delay that all rows have in common (USB, one poll), which no fit can determine."""
    window_s: Positive = 60.0
    """Length of the time window from which the rate is fitted."""
    offset_window_s: Positive = 5.0
    """Length of the time window from which the offset is fitted: long enough to contain a row with almost no delay, and
    short enough that an error of the rate does not matter."""
    max_rate_error: Positive = 0.005
    """Bound of the fitted rate error: that of a ceramic resonator."""
    rate_prior_s: Positive = 5.0
    """Time span of data at which the fitted rate error is multiplied by one half; with less data it is nearer to 0."""


@dataclass(slots=True)
class ClockCounts:
    """Numbers of rows and irregular events of one board."""

    rows: int = 0
    """Rows that arrived."""
    lost_rows: int = 0
    """Rows that did not arrive, by the gaps in the board's row counter."""
    dropped_rows: int = 0
    """Rows that were left out because they came late, came twice, did not follow the row before, or would be earlier
    than those before a restart by more than a second."""
    restarts: int = 0
    """How often the board has restarted."""
    host_steps: int = 0
    """How often the host's time stamps went back while the board's went forward."""


class BoardClock:
    """Computes the time of each row of one board on the host clock from past rows, and counts irregular events."""

    def __init__(self, settings: ClockSettings) -> None:
        self._line = _LowerLine(settings)
        self._settings = settings
        self._last: BoardReading | None = None
        self._suspect: BoardReading | None = None
        self.row_period_s = np.nan
        """Time from row to row, by both counters of the board; nan before the second row."""
        self._device_s = 0.0
        self._heard: BoardReading | None = None
        self._compared_s = np.zeros(2)
        self._host_s = -np.inf
        self._time_s = -np.inf
        self.counts = ClockCounts()

    def time_s(self, row: BoardReading) -> float | None:
        """Return when the row was measured, on the host clock; None for a row that does not follow the one before.

        There is None, too, for a row after a restart that would be more than a second earlier than those before.
        Two such rows in succession that follow each other mean that the board has restarted.
        """
        self.counts.rows += 1
        self._compare(row)
        last = self._last
        if last is not None:
            if self._follows(row, last):
                self._advance(row, last)
            elif row.boot != last.boot or (self._suspect is not None and self._follows(row, self._suspect)):
                self.counts.restarts += 1
                self._device_s += max(row.host_s - last.host_s, 0.0)
                self._line.clear()
                self._host_s = -np.inf  # a line needs its first point, even if the host's clock went back
            else:
                self.counts.dropped_rows += 1
                self._suspect = row
                return None
        if row.host_s >= self._host_s:
            self._line.add(self._device_s, row.host_s - self._device_s)
        self._last = row
        self._suspect = None
        self._host_s = max(row.host_s, self._host_s)
        time_s = self._on_host_s(self._device_s)
        if time_s < self._time_s - HOST_TOLERANCE_S:
            self.counts.dropped_rows += 1
            return None
        self._time_s = max(time_s, self._time_s + 1e-6)
        return self._time_s

    def _compare(self, row: BoardReading) -> None:
        """Add the time since the last row that the board counted on, by both clocks; of each a second at most."""
        if self._heard is not None:
            rows, device_s = _steps(row, self._heard)
            if 0 < rows < SEQ_WRAP // 2:
                steps_s = np.array([device_s, row.host_s - self._heard.host_s])
                self._compared_s += np.clip(steps_s, 0.0, HOST_TOLERANCE_S)
        self._heard = row

    def check_counters(self, board: int) -> None:
        """Check that the board with this number counts its rows and microseconds, and the host's clock seconds.

        Raises:
            InputError: when none of many rows follows the first, or one clock is much slower, as where it counts
                milliseconds.
        """
        if self.counts.rows == UNCOUNTED_ROWS == self.counts.dropped_rows + 1:
            raise InputError(
                f"board {board}: none of the first {UNCOUNTED_ROWS} rows follows the one before: expected seq to count "
                "the rows, and device_us the microseconds"
            )
        board_s, host_s = self._compared_s
        if board_s > UNIT_SPAN_S and host_s < SLOWEST_CLOCK * board_s:
            raise InputError(
                f"board {board}: host_s: went on by {host_s:.3g} s in {board_s:.3g} s on the board's clock: "
                "is the unit right, with all digits?"
            )
        if host_s > HOST_SPAN_S and board_s < SLOWEST_CLOCK * host_s:
            raise InputError(
                f"board {board}: device_us: went on by {board_s:.3g} s in {host_s:.3g} s on the host's clock: "
                "are the units of both right?"
            )

    def warning(self) -> str:
        """Return what a clock means that is slower than its fitted rate may be; empty for others.

        Rows of one that is faster have the right times: of each the delay is less than of those before.
        """
        slow, most = self._line.slope, self._settings.max_rate_error
        if slow <= most:
            return ""
        early_s = (slow - most) * self._settings.offset_window_s
        return (
            f"is {100 * slow:.2g} % slow, which clock.max_rate_error ({most:g}) does not allow for: "
            f"its rows are timed up to {early_s:.2g} s too early"
        )

    def time_of_stamp_s(self, device_us: int, boot: int) -> float | None:
        """Return when something else was measured that the board stamped shortly before or after its newest row.

        Args:
            device_us: the stamp, by the board's clock.
            boot: how often the board had started.

        Returns:
            Time on the host clock; None if the board has sent no row since it started, or none within a second.
        """
        last = self._last
        if last is None or boot != last.boot:
            return None
        since_us = (device_us - last.device_us + WRAP_US // 2) % WRAP_US - WRAP_US // 2
        if abs(since_us) > 1e6 * HOST_TOLERANCE_S:
            return None
        return self._on_host_s(self._device_s + 1e-6 * since_us)

    def _on_host_s(self, device_s: float) -> float:
        """Return the time on the host clock of a time on the board's clock."""
        return device_s + self._line.value(device_s) - self._settings.minimum_delay_s

    def _follows(self, row: BoardReading, last: BoardReading) -> bool:
        """Whether both counters of the board continue from `last`, at the row rate or in agreement with the host."""
        rows, device_s = _steps(row, last)
        if row.boot != last.boot or not (0 < rows < SEQ_WRAP // 2 and 0 < device_s < WRAP_US / 2e6):
            return False
        host_s = row.host_s - last.host_s
        along_with_host = abs(device_s - host_s) < HOST_TOLERANCE_S + 0.01 * abs(host_s)
        return along_with_host or abs(device_s / rows / self.row_period_s - 1) < ROW_PERIOD_TOLERANCE

    def _advance(self, row: BoardReading, last: BoardReading) -> None:
        rows, device_s = _steps(row, last)
        self.counts.lost_rows += rows - 1
        self.counts.host_steps += int(row.host_s < last.host_s)
        self.row_period_s = device_s / rows
        self._device_s += device_s
        if device_s > self._settings.window_s and row.host_s > self._host_s:
            self._line.clear()  # no point of it is left; in a long gap, a rate from a few seconds may err by seconds


def _steps(row: BoardReading, last: BoardReading) -> tuple[int, float]:
    """Return the rows and seconds between two rows by the board's counters, corrected for their wrap-around."""
    return (row.seq - last.seq) % SEQ_WRAP, (row.device_us - last.device_us) % WRAP_US * 1e-6


class _LowerLine:
    """The line below the latest points (device_s, host_s - device_s), on the lower hull of those in a time window.

    Only the lowest point of each second is kept: the others lie above the edge of the hull, or so near to its end that
    they have no effect.
    """

    def __init__(self, settings: ClockSettings) -> None:
        self._settings = settings
        self._lowest: deque[tuple[float, float]] = deque()
        self.clear()

    def clear(self) -> None:
        """Remove all points."""
        self._lowest.clear()
        self.slope = 0.0
        """That of the hull, which the line may have only in part; 0 while it is not known well."""
        self._rate = 0.0
        self._origin_s = 0.0
        self._offset_s = np.inf
        self._off_since_s = np.nan

    def add(self, device_s: float, offset_s: float) -> None:
        """Add a point, so that the line does not lie above it.

        Points far above the line are of rows that have waited, as in a port while the host was stopped: they are
        ignored. If they go on for `offset_window_s` on the host's clock, one of the clocks has been set, and the line
        begins anew. So it does at a point far below it, which no delay makes: the host's clock stood still, as it does
        while a computer sleeps.
        """
        above_s = offset_s - self.value(device_s) if np.isfinite(self._offset_s) else 0.0
        if above_s < -HOST_TOLERANCE_S:
            self.clear()
        elif above_s > HOST_TOLERANCE_S:
            host_s = device_s + offset_s
            if np.isnan(self._off_since_s):
                self._off_since_s = host_s
            if host_s - self._off_since_s < self._settings.offset_window_s:
                return
            self.clear()
        self._off_since_s = np.nan
        if self._lowest and int(self._lowest[-1][0]) == int(device_s):
            if offset_s < self._lowest[-1][1]:
                self._lowest[-1] = (device_s, offset_s)
        else:
            while self._lowest and self._lowest[0][0] < device_s - self._settings.window_s:
                self._lowest.popleft()
            self._lowest.append((device_s, offset_s))
            self._fit()
        self._offset_s = min(self._offset_s, offset_s - self._rate * (device_s - self._origin_s))

    def value(self, device_s: float) -> float:
        """Return the line at a device time: host time minus device time, without the delay."""
        return self._offset_s + self._rate * (device_s - self._origin_s)

    def _fit(self) -> None:
        points = np.array(self._lowest)
        hull = _lower_hull(points)
        middle = points[:, 0].mean()
        edge = min(max(int(np.searchsorted(hull[:, 0], middle)), 1), len(hull) - 1)
        span_s = points[-1, 0] - points[0, 0]
        if edge > 0 and span_s > 0:
            left_s, left_offset_s = hull[edge - 1]
            right_s, right_offset_s = hull[edge]
            weight = span_s**2 / (span_s**2 + self._settings.rate_prior_s**2)
            limit = self._settings.max_rate_error
            slope = (right_offset_s - left_offset_s) / (right_s - left_s)
            self.slope = float(slope) if span_s > RATE_SPAN_S else 0.0
            self._rate = float(np.clip(slope, -limit, limit)) * weight
        self._origin_s = float(points[-1, 0])
        recent = points[points[:, 0] >= self._origin_s - self._settings.offset_window_s]
        self._offset_s = float((recent[:, 1] - self._rate * (recent[:, 0] - self._origin_s)).min())


def _lower_hull(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vertices of the lower convex hull of points sorted by x (Andrew's monotone chain)."""
    hull: list[NDArray[np.float64]] = []
    for point in points:
        while len(hull) > 1:
            x0, y0 = hull[-2]
            x1, y1 = hull[-1]
            if (x1 - x0) * (point[1] - y0) > (y1 - y0) * (point[0] - x0):
                break
            hull.pop()
        hull.append(point)
    return np.array(hull)
