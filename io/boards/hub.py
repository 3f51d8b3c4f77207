"""The hub collects what all boards send, in order of arrival, for the recorder and the estimator."""

import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from ...models.sensor.clock import BoardClock, ClockSettings
from ...models.values.errors import InputError
from ...models.values.link import Hello, LinkReading, LinkState, PortState, rebased
from ...models.values.readings import BoardReading, arrival_s
from .inertial import BoardImu
from .port import PortReader, usb_ports
from .protocol import Message, Row, Sample
from .recorder import Recorder, RecorderThread

WAITING_ROWS = 2000
"""Largest number of readings that wait for the estimator: 20 s of two boards at 50 Hz. Older ones are skipped."""
ROWS_BEFORE_TRIAL = 100_000
"""Largest number of readings that wait, while the sensors are tared, for the recording to begin."""
STATE_S = 0.2
"""Time between two reports of the state of the ports."""
OWNER_S = 1.0
"""Time after the last row of a board on one port during which no rows of the same board are accepted on another."""


@dataclass(frozen=True, slots=True)
class LinkPlan:
    """The boards to read, and the ports to look for them."""

    board_ids: tuple[int, ...]
    """Identifier of each board of the rig."""
    channels: tuple[int, ...]
    """Number of channels of each board."""
    ports: tuple[str, ...]
    """Names of serial ports; if empty, all USB serial ports, including those that are connected later."""
    baud: int
    """Baud rate of all ports."""
    imus: tuple[tuple[int, int], ...] = ()
    """Index of the board and number on it of each inertial sensor of the rig."""
    clock: ClockSettings = field(default_factory=ClockSettings)
    """Settings of the boards' clocks, by which samples of inertial sensors are laid onto the host's."""


@dataclass(frozen=True, slots=True)
class Begin:
    """The command that begins a trial: rows from `origin_s` on belong to it, and are recorded if a path is given."""

    origin_s: float
    """Origin of the time of the trial, on the clock of `time.perf_counter`."""
    path: Path | None
    """Directory of the trial to record; None if nothing is recorded."""
    metadata: Mapping[str, Any]
    """Contents of trial.toml."""


class Hub:
    """Collects the rows and samples of all readers, stamps them in order of arrival, and passes them on."""

    def __init__(self, plan: LinkPlan) -> None:
        self._plan = plan
        self._stop = threading.Event()
        self._readers: dict[str, PortReader] = {}
        self._owner: dict[int, tuple[PortReader, float]] = {}
        self._changed = threading.Condition()
        self._clocks = [BoardClock(plan.clock) for _ in plan.board_ids]
        self._imus = {key: BoardImu(imu, self._clocks[key[0]]) for imu, key in enumerate(plan.imus)}
        self._unused_sensors: dict[int, set[int]] = {}
        self._outgoing: deque[LinkReading] = deque()
        self._before_trial: deque[LinkReading] = deque(maxlen=ROWS_BEFORE_TRIAL)
        self._recorder: RecorderThread | None = None
        self._recording_error = ""
        self._last_s = 0.0
        self._skipped_rows = 0
        self._origin_s = np.inf
        self._finished = False

    def look_for_ports(self) -> None:
        """Start a reader for each new port; the reader of a port that was disconnected waits until it is back."""
        for port in self._plan.ports or usb_ports():
            if port not in self._readers:
                self._readers[port] = PortReader(port, self._plan.baud, self.take, self._stop)
                self._readers[port].start()

    def begin(self, command: Begin, recording: ExitStack) -> None:
        """Begin the trial, with the rows that came since its origin."""
        recorder = None
        if command.path is not None:
            try:
                recorder = RecorderThread(Recorder(command.path, command.metadata, with_boot=True))
                recording.enter_context(recorder)
            except (InputError, OSError) as error:
                self._recording_error = str(error)
        with self._changed:
            self._origin_s = command.origin_s
            self._recorder = recorder
            self._skipped_rows = 0
            for row in self._before_trial:
                self._record(row)
            self._before_trial.clear()

    def take(self, reader: PortReader, messages: Sequence[Message], now_s: float) -> None:
        """Accept the messages that one reader received at one time."""
        with self._changed:
            for message in messages:
                match message:
                    case Hello():
                        reader.hello = message
                    case Row():
                        self._take_row(reader, message, now_s)
                    case Sample():
                        self._take_sample(reader, message)
            self._changed.notify()

    def send_all(self, pipe: Connection) -> None:
        """Send rows as they arrive, and the state every `STATE_S`, until `finish` is called and all rows are sent."""
        state_s = -np.inf
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._outgoing or self._finished, STATE_S)
                rows = list(self._outgoing)
                finished = self._finished
                self._outgoing.clear()
                now_s = time.perf_counter()
                state = self._state() if finished or now_s - state_s > STATE_S else None
            try:
                if rows:
                    pipe.send(rows)
                if state is not None:
                    pipe.send(state)
                    state_s = now_s
                if finished:
                    pipe.send(None)
                    return
            except OSError:  # the other process has ended
                return

    def stop_reading(self) -> None:
        """Close all ports."""
        self._stop.set()
        for reader in self._readers.values():
            reader.join()

    def finish(self) -> None:
        """Let `send_all` end when it has sent all rows."""
        with self._changed:
            self._finished = True
            self._changed.notify()

    def _take_row(self, reader: PortReader, row: Row, now_s: float) -> None:
        board = self._board(reader, row, now_s)
        if board is None:
            return
        # strictly increasing in microseconds, so that a trial is read back in the same order
        self._last_s = max(round(now_s, 6), round(self._last_s + 1e-6, 6))
        counts = np.array(row.codes, dtype=np.int64)
        reading = BoardReading(
            board=board, host_s=self._last_s, seq=row.seq, device_us=row.device_us, counts=counts, boot=row.boot
        )
        if self._imus:
            self._clocks[board].time_s(reading)
        self._hand_on(reading)

    def _take_sample(self, reader: PortReader, sample: Sample) -> None:
        """Accept a sample from the port from which the rows of its board come."""
        ids = self._plan.board_ids
        board = ids.index(sample.board_id) if sample.board_id in ids else None
        if board is None or self._owner.get(board, (None, 0.0))[0] is not reader:
            return  # as its rows, which are rejected with a complaint
        imu = self._imus.get((board, sample.sensor))
        if imu is None:
            self._unused_sensors.setdefault(board, set()).add(sample.sensor)
        elif (reading := imu.reading(sample)) is not None:
            self._hand_on(reading)

    def _board(self, reader: PortReader, row: Row, now_s: float) -> int | None:
        """Return which board of the rig sent a row, or None, with a complaint, if the row is rejected."""
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

    def _hand_on(self, reading: LinkReading) -> None:
        if np.isinf(self._origin_s):
            self._before_trial.append(reading)
        else:
            self._record(reading)
        self._outgoing.append(reading)
        if len(self._outgoing) > WAITING_ROWS:
            self._outgoing.popleft()
            self._skipped_rows += 1

    def _record(self, reading: LinkReading) -> None:
        if self._recorder is not None and arrival_s(reading) >= self._origin_s:
            self._recorder.add(rebased(reading, self._origin_s))

    def _state(self) -> LinkState:
        """Return the state of ports and recording; to be called with the lock held, since readers change it."""
        boards = {id(owner): board for board, (owner, _) in self._owner.items()}
        ports = tuple(
            PortState(
                port=reader.port,
                board=boards.get(id(reader)),
                hello=reader.hello,
                connected=reader.connected,
                counts=reader.counts,
                complaint=reader.complaint,
                unused_sensors=tuple(sorted(self._unused_sensors.get(boards.get(id(reader), -1), ()))),
            )
            for reader in list(self._readers.values())
        )
        recorder = self._recorder
        return LinkState(
            ports=ports,
            imus=tuple(imu.counts for imu in self._imus.values()),
            skipped_rows=self._skipped_rows,
            recorded_rows=recorder.rows if recorder else 0,
            recording_error=self._recording_error or (recorder.error if recorder else ""),
        )
