"""What the boards say of themselves, and what became of the bytes they sent."""

from dataclasses import dataclass, replace

from .readings import BoardReading


@dataclass(frozen=True, slots=True)
class Hello:
    """What a board says once a second."""

    board_id: int
    boot: int
    """How often it has started, as it counts itself."""
    device_us: int
    rate_hz: int
    channels: int
    firmware: str


@dataclass(frozen=True, slots=True)
class LinkCounts:
    """What a decoder made of a stream of bytes."""

    messages: int = 0
    """Whole and checked."""
    bad_crc: int = 0
    """Whole by their form, with a checksum that says otherwise."""
    garbage: int = 0
    """Pieces between two delimiters that have not the form of a message."""

    def __add__(self, other: "LinkCounts") -> "LinkCounts":
        return LinkCounts(self.messages + other.messages, self.bad_crc + other.bad_crc, self.garbage + other.garbage)


@dataclass(frozen=True, slots=True)
class PortState:
    """One serial port, at one moment."""

    port: str
    board: int | None = None
    """Index in the rig of the board that was last heard there."""
    hello: Hello | None = None
    connected: bool = False
    counts: LinkCounts = LinkCounts()
    complaint: str = ""
    """Why nothing is taken from it, if so."""


@dataclass(frozen=True, slots=True)
class LinkState:
    """The process that reads the boards and writes the recording, at one moment."""

    ports: tuple[PortState, ...] = ()
    skipped_rows: int = 0
    """Rows that were recorded, yet never reached the estimator, which had fallen too far behind."""
    recorded_rows: int = 0
    recording_error: str = ""


def rebased(row: BoardReading, origin_s: float) -> BoardReading:
    """Return a row with its arrival counted from an origin, in the whole microseconds that a trial is written in."""
    return replace(row, host_s=round(row.host_s - origin_s, 6))
