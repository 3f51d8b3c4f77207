"""What a robot that is not held stands on or hangs from, and what it carries beside its tendons."""

from dataclasses import dataclass

from ..structure.floor import Floor
from ..values.aids import Imu


@dataclass(frozen=True, slots=True, eq=False)
class FreeStandingRobot:
    """What is known of a free-standing robot beside its structure."""

    floor: Floor
    imus: tuple[Imu, ...]
    range_pairs: tuple[tuple[int, int, int], ...]
    """The pairs of beacon and node between which ranges may be measured, see `RangeReading.pair`."""
    rest_seconds: float
    """How long it stands at its rest shape at the start."""
    own_frames: int = 0
    """Number of recordings of positions in frames of their own."""


@dataclass(frozen=True, slots=True, eq=False)
class HangingRobot:
    """What is known of a robot that hangs from one anchor, or swings about two, beside its structure."""

    imus: tuple[Imu, ...]
    range_pairs: tuple[tuple[int, int, int], ...]
    """See `FreeStandingRobot`."""
    rest_seconds: float
    """How long it hangs at its rest shape at the start."""
    anchor_m: float
    """Standard deviation of an anchor's position, per axis."""
    own_frames: int = 0
    """See `FreeStandingRobot`."""
