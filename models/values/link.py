"""The state of the serial link: what each board reports about itself, and how many of its messages were intact."""

from dataclasses import dataclass, replace

from .aids import DECIMALS, ImuReading
from .readings import BoardReading

LinkReading = BoardReading | ImuReading
"""What the link delivers: a row of a board, or a sample of an inertial sensor that a board reads."""


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
    unused_sensors: tuple[int, ...] = ()
    """Numbers of the board's inertial sensors that the rig does not name."""


@dataclass(frozen=True, slots=True)
class ImuCounts:
    """Numbers of samples of one inertial sensor that a board reads."""

    samples: int = 0
    """Samples that were taken."""
    lost_samples: int = 0
    """Samples that did not arrive, by the gaps in the sensor's counter."""
    dropped_samples: int = 0
    """Samples that were left out because they came twice or late, or could not be laid onto the host's clock."""

    def __add__(self, other: "ImuCounts") -> "ImuCounts":
        return ImuCounts(
            self.samples + other.samples,
            self.lost_samples + other.lost_samples,
            self.dropped_samples + other.dropped_samples,
        )


@dataclass(frozen=True, slots=True)
class LinkState:
    """The process that reads the boards and writes the recording, at one moment."""

    ports: tuple[PortState, ...] = ()
    imus: tuple[ImuCounts, ...] = ()
    """The inertial sensors of the rig, in the order of their numbers."""
    skipped_rows: int = 0
    """Rows that were recorded but not given to the estimator, because it had fallen too far behind."""
    recorded_rows: int = 0
    recording_error: str = ""


def rebased(reading: LinkReading, origin_s: float) -> LinkReading:
    """Return a reading whose time counts from an origin, rounded as in a trial's files."""
    if isinstance(reading, ImuReading):
        return replace(reading, t_s=round(reading.t_s - origin_s, DECIMALS))
    return replace(reading, host_s=round(reading.host_s - origin_s, 6))
