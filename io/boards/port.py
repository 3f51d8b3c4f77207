"""Serial ports: listing them, asking which board is connected, reading them in spite of unplugged cables."""

import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from errno import EACCES, EAGAIN, EBUSY, EINVAL, EIO, EISDIR, ENODEV, ENOENT, ENXIO

import serial
from serial.tools import list_ports

from ...models.values.errors import reason_of
from ...models.values.link import Hello, LinkCounts
from .protocol import Decoder, Message, Row

RETRY_S = 0.25
"""Time between two attempts to open a port."""
UNREADABLE = "sends what cannot be read: are baud rate and form of its rows right?"
"""What is told of a port with bytes and no message."""
UNREAD_S = 2.0
"""Time without a message after which damaged bytes from a board are told, and not only counted."""
REASONS = {
    ENOENT: "not there",
    EAGAIN: "in use by another program",
    EACCES: "no permission",
    EBUSY: "in use by another program",
    EISDIR: "a directory, not a port",
}
"""What is told of a port that cannot be opened, by the number of the system's error."""
POLL_S = 0.1
"""Longest time that a read waits for a byte before it checks whether it should stop."""


@dataclass(frozen=True, slots=True)
class PortAnswer:
    """The answer of one port."""

    port: str
    description: str
    """Description of the USB device by the operating system."""
    board_id: int | None = None
    hello: Hello | None = None
    """The hello message; None if the board sends only rows, as in the line protocol."""
    channels: int | None = None
    error: str = ""
    """Reason why no board is known: the port could not be opened, or sends `UNREADABLE`; empty if it is silent."""


def usb_ports() -> dict[str, str]:
    """Return the serial ports that are USB devices, with the system's description; none while one is unplugged."""
    try:
        return {port.device: port.description or "" for port in list_ports.comports() if port.vid is not None}
    except _PORT_ERRORS:  # the files that describe the device went while they were read
        return {}


def ask(port: str, description: str, baud: int, seconds: float) -> PortAnswer:
    """Listen to a port until its board has sent a hello message, at most for the given time.

    Opening a port restarts most boards: a Mega answers after about two seconds.
    """
    row: Row | None = None
    try:
        with _opened(port, baud) as line:
            decoder = Decoder()
            until_s = time.monotonic() + seconds
            while time.monotonic() < until_s:
                for message in decoder.feed(line.read(max(1, line.in_waiting))):
                    if isinstance(message, Hello):
                        return PortAnswer(
                            port=port,
                            description=description,
                            board_id=message.board_id,
                            hello=message,
                            channels=message.channels,
                        )
                    if isinstance(message, Row):
                        row = message
    except _PORT_ERRORS as error:
        return PortAnswer(port, description, error=_reason(error))
    if row:
        return PortAnswer(port=port, description=description, board_id=row.board_id, channels=len(row.codes))
    damaged = decoder.counts.garbage + decoder.counts.bad_crc
    return PortAnswer(port, description, error=UNREADABLE if damaged else "")


class PortReader(threading.Thread):
    """Thread that reads one port, and opens it again after every disconnection."""

    def __init__(
        self, port: str, baud: int, deliver: Callable[["PortReader", list[Message], float], None], stop: threading.Event
    ) -> None:
        super().__init__(daemon=True, name=f"reader of {port}")
        self.port = port
        self.connected = False
        self.complaint = ""
        self.hello: Hello | None = None
        self._baud = baud
        self._deliver = deliver
        self._stop_asked = stop
        self._counts = LinkCounts()
        self._decoder = Decoder()
        self._understood = LinkCounts()
        self._understood_s = 0.0

    @property
    def counts(self) -> LinkCounts:
        """How many messages of the port were intact or damaged so far."""
        return self._counts + self._decoder.counts

    def run(self) -> None:
        """Read until asked to stop."""
        while not self._stop_asked.is_set():
            try:
                with _opened(self.port, self._baud) as line:
                    self.connected = True
                    self.complaint = ""
                    self._understood, self._understood_s = self.counts, time.perf_counter()
                    while not self._stop_asked.is_set():
                        if data := line.read(max(1, line.in_waiting)):
                            now_s = time.perf_counter()
                            messages = self._decoder.feed(data)
                            self._judge(messages, now_s)
                            self._deliver(self, messages, now_s)
            except _PORT_ERRORS as error:
                self.complaint = _reason(error)
            if self._stop_asked.is_set():
                return  # the last report tells where rows came from
            self.connected = False
            self._counts = self.counts
            self._decoder = Decoder()
            self._stop_asked.wait(RETRY_S)

    def _judge(self, messages: list[Message], now_s: float) -> None:
        """Complain where nothing has been understood for a while of what comes from a board; others are no boards."""
        if messages:
            self._understood, self._understood_s = self.counts, now_s
        elif self._understood.messages and now_s - self._understood_s > UNREAD_S and self.counts != self._understood:
            self.complaint = UNREADABLE


def _opened(port: str, baud: int) -> serial.Serial:
    try:
        return serial.Serial(port, baud, timeout=POLL_S, exclusive=True)
    except (ValueError, OverflowError) as error:
        raise OSError(EINVAL, f"{baud} baud: {error}") from error


def _port_errors() -> tuple[type[Exception], ...]:
    """Return the types of errors that pyserial raises when a device is disconnected during a call."""
    try:
        import termios
    except ImportError:  # Windows
        return OSError, TypeError
    return OSError, TypeError, termios.error


_PORT_ERRORS = _port_errors()


def _reason(error: Exception) -> str:
    """Return the reason that the system gives, without the text that pyserial adds."""
    number = getattr(error, "errno", None)
    if number in (None, EIO, ENODEV, ENXIO):
        return "the device is gone"
    if number in REASONS:
        return REASONS[number]
    system = os.strerror(number) if isinstance(error, serial.SerialException) else reason_of(error)
    return f"cannot be opened: {system}"
