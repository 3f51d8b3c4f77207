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
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from ...models.values.errors import InputError, TensegraphError
from ...models.values.link import Hello, LinkState, PortState, rebased
from ...models.values.readings import BoardReading
from .port import PortReader, usb_ports
from .protocol import Message, Row
from .recorder import Recorder, RecorderThread

WAITING_ROWS = 2000
"""Rows that may wait for the estimator: 20 s of two boards at 50 Hz. Older ones are skipped, and counted."""
HELD_ROWS = 20_000
"""Rows that may wait for the recording to begin: while the sensors are tared."""
STATE_S = 0.2
"""Between two reports of the ports' state."""
SWITCH_S = 0.0002
"""How long another thread may hold up a reader. With Python's 5 ms, a recording that began cost it 100 ms."""
OWNER_S = 1.0
"""A board that was heard within this time on one port is not taken from another."""


@dataclass(frozen=True, slots=True)
class LinkPlan:
    """Which boards to read, and where to look for them."""

    board_ids: tuple[int, ...]
    """Of each board of the rig."""
    channels: tuple[int, ...]
    """Of each board."""
    ports: tuple[str, ...]
    """None: all USB serial ports, also those that are plugged in later."""
    baud: int


@dataclass(frozen=True, slots=True)
class _Begin:
    """Rows from `origin_s` on are the trial's, counted from there; with a path, they are recorded."""

    origin_s: float
    path: Path | None
    metadata: Mapping[str, Any]


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
            self._receive(STATE_S)

    def begin(self, origin_s: float, path: Path | None = None, metadata: Mapping[str, Any] | None = None) -> None:
        """Begin a trial with the first row from `origin_s` on; record it if a path is given.

        A recording that cannot be, or ends early, says so in `state`.
        """
        self._pipe.send(_Begin(origin_s, path, metadata or {}))

    def rows(self) -> Iterator[BoardReading]:
        """Yield rows, their arrival by `time.perf_counter`, until `stop` and all that came before it.

        Raises:
            TensegraphError: when the other process ended by itself.
        """
        while self.waiting() or not self._ended:
            if self._rows:
                yield self._rows.popleft()
            else:
                self._receive(STATE_S)

    def waiting(self) -> int:
        """Return how many rows have come and were not yet yielded."""
        self._receive(0.0)
        return len(self._rows)

    def stop(self) -> None:
        """Read no more; what has come is still yielded."""
        if not self._stopping:
            self._stopping = True
            self._pipe.send(None)

    def _receive(self, timeout_s: float) -> None:
        """Take in what the other process sent, waiting for the first of it; leave there what is too much."""
        try:
            while not self._ended and len(self._rows) < WAITING_ROWS and self._pipe.poll(timeout_s):
                timeout_s = 0.0
                message = self._pipe.recv()
                if isinstance(message, LinkState):
                    self.state, self._reads = message, True
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
        hub = _Hub(plan)
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


class _Hub:
    """Where the rows of all readers meet: stamped, in order, and handed on to the recorder and the estimator."""

    def __init__(self, plan: LinkPlan) -> None:
        self._plan, self._stop = plan, threading.Event()
        self._readers: dict[str, PortReader] = {}
        self._owner: dict[int, tuple[PortReader, float]] = {}
        self._changed = threading.Condition()
        self._outgoing: deque[BoardReading] = deque()
        self._held: deque[BoardReading] = deque(maxlen=HELD_ROWS)
        self._recorder: RecorderThread | None = None
        self._recording_error = ""
        self._last_s, self._skipped_rows, self._origin_s, self._finished = 0.0, 0, np.inf, False

    def look_for_ports(self) -> None:
        """Start a reader for each port that is new; those of ports that went away wait for them to come back."""
        for port in self._plan.ports or usb_ports():
            if port not in self._readers:
                self._readers[port] = PortReader(port, self._plan.baud, self.take, self._stop)
                self._readers[port].start()

    def begin(self, command: _Begin, recording: ExitStack) -> None:
        """Begin the trial, with the rows that were held since its origin."""
        recorder = None
        if command.path is not None:
            try:
                recorder = RecorderThread(Recorder(command.path, command.metadata, with_boot=True))
                recording.enter_context(recorder)
            except InputError as error:
                self._recording_error = str(error)
        with self._changed:
            self._origin_s, self._recorder, self._skipped_rows = command.origin_s, recorder, 0
            for row in self._held:
                self._record(row)
            self._held.clear()

    def take(self, reader: PortReader, messages: Sequence[Message], now_s: float) -> None:
        """Take in what one reader got, at the time it got it."""
        with self._changed:
            for message in messages:
                if isinstance(message, Hello):
                    reader.hello = message
                elif (board := self._board(reader, message, now_s)) is not None:
                    # one order of arrival for all, to the microsecond, so that a trial read back is the same stream
                    self._last_s = max(round(now_s, 6), round(self._last_s + 1e-6, 6))
                    counts = np.array(message.codes, dtype=np.int64)
                    self._hand_on(
                        BoardReading(board, self._last_s, message.seq, message.device_us, counts, message.boot)
                    )
            self._changed.notify()

    def send_all(self, pipe: Connection) -> None:
        """Send rows as they come, and the state now and then, until all is sent."""
        state_s = -np.inf
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._outgoing or self._finished, STATE_S)
                rows, finished = list(self._outgoing), self._finished
                self._outgoing.clear()
            now_s = time.perf_counter()
            try:
                if rows:
                    pipe.send(rows)
                if finished or now_s - state_s > STATE_S:
                    pipe.send(self._state())
                    state_s = now_s
                if finished:
                    pipe.send(None)
                    return
            except OSError:  # the other side is gone
                return

    def stop_reading(self) -> None:
        """Close all ports."""
        self._stop.set()
        for reader in self._readers.values():
            reader.join()

    def finish(self) -> None:
        """Let the sender end when all is sent."""
        with self._changed:
            self._finished = True
            self._changed.notify()

    def _board(self, reader: PortReader, row: Row, now_s: float) -> int | None:
        """Return which board of the rig sent a row, or None, with the complaint set, if it is not to be taken."""
        ids = self._plan.board_ids
        if row.board_id not in ids:
            reader.complaint = f"board {row.board_id} is not in the rig: expected {', '.join(map(str, ids))}"
            return None
        board = ids.index(row.board_id)
        if len(row.codes) != self._plan.channels[board]:
            reader.complaint = (
                f"board {row.board_id} sends {len(row.codes)} channels, the rig has {self._plan.channels[board]}"
            )
            return None
        owner, heard_s = self._owner.get(board, (reader, now_s))
        if owner is not reader and now_s - heard_s < OWNER_S:
            reader.complaint = f"board {row.board_id} is on {owner.port} too: flash one with another BOARD_ID"
            return None
        self._owner[board] = reader, now_s
        reader.complaint = ""
        return board

    def _hand_on(self, row: BoardReading) -> None:
        if np.isinf(self._origin_s):
            self._held.append(row)
        else:
            self._record(row)
        self._outgoing.append(row)
        if len(self._outgoing) > WAITING_ROWS:
            self._outgoing.popleft()
            self._skipped_rows += 1

    def _record(self, row: BoardReading) -> None:
        if self._recorder is not None and row.host_s >= self._origin_s:
            self._recorder.add(rebased(row, self._origin_s))

    def _state(self) -> LinkState:
        boards = {id(owner): board for board, (owner, _) in self._owner.items()}
        ports = tuple(
            PortState(r.port, boards.get(id(r)), r.hello, r.connected, r.counts, r.complaint)
            for r in list(self._readers.values())
        )
        recorder = self._recorder
        return LinkState(
            ports,
            self._skipped_rows,
            recorder.rows if recorder else 0,
            self._recording_error or (recorder.error if recorder else ""),
        )
