"""The state of the serial link: what each board reports about itself, and how many of its messages were intact."""

from dataclasses import dataclass, replace

from .readings import BoardReading


@dataclass(frozen=True, slots=True)
class Hello:
    """The message in which a board describes itself, once a second."""

    board_id: int
    boot: int
    """How often the board has started, by its own count."""
    device_us: int
    rate_hz: int
    channels: int
    firmware: str


@dataclass(frozen=True, slots=True)
class LinkCounts:
    """How many messages a decoder has found in a stream of bytes."""

    messages: int = 0
    """Messages whose form and checksum are right."""
    bad_crc: int = 0
    """Messages whose form is right and whose checksum is wrong."""
    garbage: int = 0
    """Pieces between two delimiters that do not have the form of a message."""

    def __add__(self, other: "LinkCounts") -> "LinkCounts":
        return LinkCounts(self.messages + other.messages, self.bad_crc + other.bad_crc, self.garbage + other.garbage)


@dataclass(frozen=True, slots=True)
class PortState:
    """One serial port, at one moment."""

    port: str
    board: int | None = None
    """Index in the rig of the board from which this port last received a message."""
    hello: Hello | None = None
    connected: bool = False
    counts: LinkCounts = LinkCounts()
    complaint: str = ""
    """Why no rows are taken from this port; empty when they are."""


@dataclass(frozen=True, slots=True)
class LinkState:
    """The process that reads the boards and writes the recording, at one moment."""

    ports: tuple[PortState, ...] = ()
    skipped_rows: int = 0
    """Rows that were recorded but not given to the estimator, because it had fallen too far behind."""
    recorded_rows: int = 0
    recording_error: str = ""


def rebased(row: BoardReading, origin_s: float) -> BoardReading:
    """Return a row whose arrival time counts from an origin, rounded to whole microseconds as in a trial's files."""
    return replace(row, host_s=round(row.host_s - origin_s, 6))
