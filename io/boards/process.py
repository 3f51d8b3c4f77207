"""The boards are read and recorded in a separate process, so that the estimator can never delay them.

port -> reader thread --+                    +-> recorder thread -> disk     (every row)
                        +-> stamp, in order -+
port -> reader thread --+                    +-> pipe -> the estimator       (the newest, if it fell far behind)
"""

import gc
import multiprocessing
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from math import inf
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Self

from ...models.values.errors import TensegraphError
from ...models.values.link import LinkReading, LinkState
from ...models.values.readings import arrival_s
from .hub import STATE_S, WAITING_ROWS, Begin, Hub, LinkPlan

TERMINAL_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGHUP") if hasattr(signal, name))
"""What a terminal sends to both processes, at Ctrl-C and when it is closed; only the command's own handles it."""
SWITCH_S = 0.0002
"""Switch interval of Python's threads. With the default, 5 ms, the start of a recording delayed a reader by 100 ms."""
OLDEST_S = 10.0
"""Age above which a reading is skipped if newer ones wait. On a machine without time for it, where ten rows take a
second, the estimator was three minutes late without this limit; after a stall of seconds it catches up by itself."""


class SerialLink:
    """The rows of all boards and the samples of their inertial sensors, from the process that reads them.

    They come in order of arrival. A context manager; if the other process ended by itself, rows end, and it raises a
    TensegraphError at the end of the block.
    """

    def __init__(self, plan: LinkPlan) -> None:
        self._state = LinkState()
        self._skipped_rows = 0
        self._rows: deque[LinkReading] = deque()
        self._reads = self._ended = self._died = self._stopping = self._only_records = False
        context = multiprocessing.get_context("spawn")  # gtsam's threads do not survive a fork
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(plan, theirs), daemon=True)
        with _terminal_ignored():
            self._process.start()
        theirs.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.stop()
        for _ in self.rows():
            pass
        self._process.join()
        self._pipe.close()
        if self._died:
            hint = "" if self._reads else ": does the script call it under if __name__ == '__main__'?"
            raise TensegraphError(f"the process that reads the boards ended by itself{hint}")

    @property
    def state(self) -> LinkState:
        """State of ports and recording, as last reported by the process."""
        return replace(self._state, skipped_rows=self._state.skipped_rows + self._skipped_rows)

    def wait_until_it_reads(self) -> None:
        """Wait until the other process has started, which takes seconds on a busy machine."""
        while not (self._reads or self._ended):
            self.receive(STATE_S)

    def begin(
        self,
        origin_s: float,
        path: Path | None = None,
        metadata: Mapping[str, Any] | None = None,
        *,
        only_records: bool = False,
    ) -> None:
        """Begin a trial with the first row from `origin_s` on; record it if a path is given.

        If the recording cannot be written or ends early, `state` contains the error; where rows are wanted for the
        recording alone, reading stops then.
        """
        self._skipped_rows = 0
        self._only_records = only_records
        self._send(Begin(origin_s, path, metadata or {}))

    def rows(self, until_s: float = inf) -> Iterator[LinkReading]:
        """Yield rows, with arrival times of `time.perf_counter`, until all rows that came before `stop` are yielded.

        Rows older than `OLDEST_S` are skipped while newer ones wait.

        Args:
            until_s: time on that clock after which no row is yielded, and nothing is waited for where boards are
                silent; later rows are kept for the next call.
        """
        self.receive()
        while self._rows or not self._ended:
            if not self._rows:
                self.receive(STATE_S)
                if not self._rows and time.perf_counter() > until_s:
                    return
                continue
            if arrival_s(self._rows[0]) > until_s:
                return
            row = self._rows.popleft()
            if self._rows and time.perf_counter() - arrival_s(row) > OLDEST_S:
                self._skipped_rows += 1
            else:
                yield row
            self.receive()

    def waiting(self) -> int:
        """Return how many rows have been received and not yet yielded."""
        return len(self._rows)

    def stop(self) -> None:
        """Stop reading; rows that have arrived are still yielded."""
        if not self._stopping:
            self._stopping = True
            self._send(None)

    def _send(self, command: Begin | None) -> None:
        with suppress(OSError):  # the other process has ended, as `receive` will find
            self._pipe.send(command)

    def receive(self, timeout_s: float = 0.0) -> None:
        """Receive the rows and the state that the other process has sent.

        At most about `WAITING_ROWS` rows are held here; further ones stay in the other process.

        Args:
            timeout_s: how long to wait if nothing has been sent.
        """
        try:
            while not self._ended and len(self._rows) < WAITING_ROWS and self._pipe.poll(timeout_s):
                timeout_s = 0.0
                message = self._pipe.recv()
                if isinstance(message, LinkState):
                    self._state = message
                    self._reads = True
                    if self._only_records and message.recording_error:
                        self.stop()
                elif message is None:
                    self._ended, self._died = True, not self._stopping
                else:
                    self._rows.extend(message)
        except (EOFError, OSError):
            self._ended = self._died = True


@contextmanager
def _terminal_ignored() -> Iterator[None]:
    """Ignore `TERMINAL_SIGNALS`, so that a process that starts here does so from its beginning."""
    if threading.current_thread() is not threading.main_thread():  # no other may do so
        yield
        return
    handlers = {number: signal.signal(number, signal.SIG_IGN) for number in TERMINAL_SIGNALS}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _serve(plan: LinkPlan, pipe: Connection) -> None:
    """Read boards until the other process asks to stop or has ended.

    A termination ends it in order, too: `timeout` and service managers send one to all processes of a command.
    """
    terminated = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: terminated.set())
    for number in TERMINAL_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    sys.setswitchinterval(SWITCH_S)
    gc.freeze()  # exclude existing objects from garbage collection, which would delay every reader by 75 ms
    with ExitStack() as recording:
        hub = Hub(plan)
        sender = threading.Thread(target=hub.send_all, args=(pipe,), daemon=True)
        sender.start()
        try:
            while not terminated.is_set():
                hub.look_for_ports()
                if pipe.poll(STATE_S):
                    command = pipe.recv()
                    if command is None:
                        break
                    hub.begin(command, recording)
        except (EOFError, OSError):  # the other process has ended
            pass
        hub.stop_reading()
        recording.close()
        hub.finish()
        sender.join()
