"""A board by its bytes alone."""

import os
import threading
import time
import tty
from collections import deque
from pathlib import Path

from tensegraph.io.boards.protocol import Row, Sample, frame
from tensegraph.models.values.link import Hello


class PtyBoard:
    """A board of ours by its bytes alone, on a pty: for what firmware would never do. One row each 20 ms."""

    def __init__(self, port: Path, board_id: int, channels: int = 12) -> None:
        self.port, self.board_id, self.channels = port, board_id, channels
        self.boot, self.seq = 0, 0
        self.period_s = 0.02
        """Time from row to row, which the board's own stamps do not follow."""
        self.sensors: tuple[int, ...] = ()
        """Numbers of the inertial sensors that are wired to it, which are read twice for each row."""
        self.interference: deque[bytes] = deque()
        """Each is put on the line once, between two frames."""
        self.sent: list[tuple[int, int]] = []
        """(boot, seq) of every row that a port took."""
        self._stop, self._thread = threading.Event(), threading.Thread()

    def plug(self) -> None:
        """Make the port, and begin to send."""
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port.symlink_to(os.ttyname(self._slave))
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Take the port away; the board starts anew when it is plugged in again."""
        if self._thread.is_alive():
            self._stop.set()
            self._thread.join()
            self.port.unlink()
            os.close(self._master)
            os.close(self._slave)
            self.boot, self.seq = self.boot + 1, 0

    def sample(self, sensor: int, seq: int) -> Sample:
        """Return a sample of a sensor at rest: 0.001 rad/s a digit, 0.002 m/s^2 a digit, the counter in one axis."""
        rate, force = (seq % 1000, -3, 5), (0, sensor, 4905)
        return Sample(
            self.board_id, self.boot, sensor, seq % 2**16, 10_000 * (seq - 1) % 2**32, 1e-3, 2e-3, rate, force
        )

    def codes(self) -> tuple[int, ...]:
        """Return the codes of the next row: a counter, which starts elsewhere on each channel."""
        return tuple((self.seq + 31 * c) % 1024 for c in range(self.channels))

    def _run(self) -> None:
        next_s = time.perf_counter()
        while not self._stop.wait(max(next_s - time.perf_counter(), 0)):
            next_s += self.period_s
            data = b"".join(frame(self.sample(sensor, 2 * self.seq + k)) for sensor in self.sensors for k in (0, 1))
            data += frame(Row(self.board_id, self.boot, self.seq % 2**16, 20_000 * self.seq % 2**32, self.codes()))
            if self.seq % 50 == 0:
                data += frame(Hello(self.board_id, self.boot, 20_000 * self.seq % 2**32, 50, self.channels, "pty 1"))
            if self.interference:
                data = self.interference.popleft() + data
            try:
                os.write(self._master, data)
                self.sent.append((self.boot, self.seq))
            except BlockingIOError:  # nobody reads
                pass
            self.seq += 1
