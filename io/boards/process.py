"""The boards, read and recorded in a process of its own: whatever the estimator does, no byte waits for it.

port -> reader thread --+                    +-> recorder thread -> disk     (every row)
                        +-> stamp, in order -+
port -> reader thread --+                    +-> pipe -> the estimator       (the newest, if it fell far behind)
"""

import gc
import multiprocessing
import signal
import sys
import threading
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from ...models.values.errors import TensegraphError
from ...models.values.link import LinkState
from ...models.values.readings import BoardReading
from .hub import STATE_S, WAITING_ROWS, Begin, Hub, LinkPlan

SWITCH_S = 0.0002
"""How long another thread may hold up a reader. With Python's 5 ms, a recording that began cost it 100 ms."""


class SerialLink:
    """The rows of all boards, in order of arrival, from another process; a context manager."""

    def __init__(self, plan: LinkPlan) -> None:
        self.state = LinkState()
        """As last reported."""
        self._rows: deque[BoardReading] = deque()
        self._reads = self._ended = self._stopping = False
        context = multiprocessing.get_context("spawn")  # gtsam's threads do not survive a fork
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(plan, theirs), daemon=True)
        on_interrupt = signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group: we decide
        self._process.start()
        signal.signal(signal.SIGINT, on_interrupt)
        theirs.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()
        for _ in self.rows():
            pass
        self._process.join()
        self._pipe.close()

    def wait_until_it_reads(self) -> None:
        """Wait until the other process has started, which takes seconds on a busy machine."""
        while not self._reads:
            self.receive(STATE_S)

    def begin(self, origin_s: float, path: Path | None = None, metadata: Mapping[str, Any] | None = None) -> None:
        """Begin a trial with the first row from `origin_s` on; record it if a path is given.

        A recording that cannot be, or ends early, says so in `state`.
        """
        self._pipe.send(Begin(origin_s, path, metadata or {}))

    def rows(self) -> Iterator[BoardReading]:
        """Yield rows, their arrival by `time.perf_counter`, until `stop` and all that came before it.

        Raises:
            TensegraphError: when the other process ended by itself.
        """
        self.receive()
        while self._rows or not self._ended:
            if self._rows:
                yield self._rows.popleft()
                self.receive()
            else:
                self.receive(STATE_S)

    def waiting(self) -> int:
        """Return how many rows have been received and not yet yielded."""
        return len(self._rows)

    def stop(self) -> None:
        """Read no more; what has come is still yielded."""
        if not self._stopping:
            self._stopping = True
            self._pipe.send(None)

    def receive(self, timeout_s: float = 0.0) -> None:
        """Receive the rows and the state that the other process has sent.

        At most about `WAITING_ROWS` rows are held here; further ones stay in the other process.

        Args:
            timeout_s: how long to wait if nothing has been sent.

        Raises:
            TensegraphError: when the other process ended by itself.
        """
        try:
            while not self._ended and len(self._rows) < WAITING_ROWS and self._pipe.poll(timeout_s):
                timeout_s = 0.0
                message = self._pipe.recv()
                if isinstance(message, LinkState):
                    self.state = message
                    self._reads = True
                elif message is None:
                    self._ended = True
                else:
                    self._rows.extend(message)
        except (EOFError, OSError) as error:
            self._ended = True
            raise TensegraphError("the process that reads the boards ended by itself") from error


def _serve(plan: LinkPlan, pipe: Connection) -> None:
    """Read boards until the other side says so, or is gone."""
    sys.setswitchinterval(SWITCH_S)
    gc.freeze()  # to look through all that was imported would hold up every reader by 75 ms
    with ExitStack() as recording:
        hub = Hub(plan)
        sender = threading.Thread(target=hub.send_all, args=(pipe,), daemon=True)
        sender.start()
        try:
            while True:
                hub.look_for_ports()
                if pipe.poll(STATE_S):
                    command = pipe.recv()
                    if command is None:
                        break
                    hub.begin(command, recording)
        except (EOFError, OSError):  # the other side is gone
            pass
        hub.stop_reading()
        recording.close()
        hub.finish()
        sender.join()
