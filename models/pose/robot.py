"""What a free-standing robot stands on, and what it carries beside its tendons."""

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
