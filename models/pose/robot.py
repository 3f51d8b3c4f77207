"""What a robot that is not held stands on or hangs from, and what it carries beside its tendons."""

from dataclasses import dataclass, replace
from typing import Self

from ..structure.floor import UP, Floor
from ..values.aids import Imu
from ..values.stamps import rest_until_s

NO_FLOOR = Floor(-1e3, UP)
"""A floor that no node can touch."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Robot:
    """What is known of a robot that is not held, beside its structure."""

    floor: Floor
    rest_seconds: float
    """How long it stands or hangs at its rest shape, from the first frame on."""
    imus: tuple[Imu, ...] = ()
    range_pairs: tuple[tuple[int, int, int], ...] = ()
    """The pairs of beacon and node between which ranges may be measured, see `RangeReading.pair`."""
    own_frames: int = 0
    """Number of recordings of positions in frames of their own."""
    first_frame_s: float = 0.0
    """t_s of the first frame, which is known when it arrives, see `begun`."""

    @property
    def beacons(self) -> tuple[tuple[int, int], ...]:
        """The recording and the number of each beacon."""
        return tuple(dict.fromkeys((recording, beacon) for recording, beacon, _ in self.range_pairs))

    @property
    def rest_until_s(self) -> float:
        """Time until which it is at its rest shape, on the clock of the frames."""
        return rest_until_s(self.first_frame_s, self.rest_seconds)

    def begun(self, first_frame_s: float) -> Self:
        """Return the robot with the time of its first frame."""
        return replace(self, first_frame_s=first_frame_s)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FreeStandingRobot(Robot):
    """One that stands on a floor."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HangingRobot(Robot):
    """One that hangs from one anchor, or swings about two."""

    floor: Floor = NO_FLOOR
    anchor_m: float
    """Standard deviation of an anchor's position, per axis."""
