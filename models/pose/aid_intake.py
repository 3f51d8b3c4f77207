"""The readings of other sensors than those of tendons, on their way to the frames in which they are used."""

from bisect import bisect_right, insort
from collections.abc import Sequence
from dataclasses import replace

from ..structure.rest_shape import RestShape
from ..values.aids import AidReading, ImuReading, PositionReading
from ..values.readings import TendonLengths
from ..values.stamps import RestClock
from .aid_use import OLD_S, AidUse
from .filled_positions import FilledPositions
from .imu_gate import ImuGate
from .position_frames import OwnFrames


class AidIntake:
    """Takes the readings of other sensors as they arrive, and gives those that are used to the frames."""

    def __init__(
        self,
        rest: RestShape,
        rest_seconds: float,
        position_m: float,
        *,
        imus: int,
        ranges: int,
        positions: Sequence[int],
        own_frames: Sequence[int],
    ) -> None:
        """Begin before the first reading.

        Args:
            rest: the rest shape.
            rest_seconds: how long the structure rests from the first frame on.
            position_m: standard deviation of a position, per axis.
            imus: number of inertial sensors.
            ranges: number of recordings of ranges.
            positions: the numbers of the recordings of positions in the world.
            own_frames: those of positions in frames of their own.
        """
        rest_clock = RestClock(rest_seconds)
        self.imu_gate = ImuGate(imus, rest_clock)  # which counts the frames for the clock
        self.own_frames = OwnFrames(rest, own_frames, rest_clock, position_m)
        self.use = AidUse(rest.node_position_m, imus, ranges, positions, is_held=rest.structure.is_held)
        """What is used of each recording."""
        self._filled_positions = FilledPositions()
        self._waiting: list[AidReading] = []

    def take(self, reading: AidReading) -> bool:
        """Take a reading that has arrived; return whether it waits for its frame, and is not left out."""
        self.use.read(reading)
        admitted = self._admitted(reading)
        if admitted is None:
            return False
        insort(self._waiting, admitted, key=lambda aid: aid.t_s)  # boards are not synchronous
        return True

    def given_to(self, lengths: TendonLengths) -> TendonLengths:
        """Return a frame with the readings up to its time, which wait no more.

        Those older than `OLD_S` are left out, as those of a clock that is another one.
        """
        self.imu_gate.count_frame(lengths.t_s)
        self.use.count_frame(lengths.t_s)
        if not self._waiting:
            return lengths
        until = bisect_right(self._waiting, lengths.t_s, key=lambda aid: aid.t_s)
        taken = tuple(aid for aid in self._waiting[:until] if lengths.t_s - aid.t_s < OLD_S)
        del self._waiting[:until]
        return replace(lengths, aids=taken)

    def warnings(self) -> dict[str, str]:
        """Return what looks wrong of sensors and recordings, by their names."""
        of_samples, unused = self.imu_gate.warnings(), self.use.lines()
        names = of_samples | unused
        return {name: "; ".join(texts[name] for texts in (unused, of_samples) if name in texts) for name in names}

    def counts(self) -> dict[str, int]:
        """Return how many readings were left out, by what they are of and why."""
        parts = (self.imu_gate, self.use, self.own_frames, self._filled_positions)
        return {name: count for part in parts for name, count in part.counts().items()}

    def _admitted(self, reading: AidReading) -> AidReading | None:
        """Return a reading as the estimators use it; None where it is left out."""
        if isinstance(reading, PositionReading):
            return self.own_frames.placed(reading) if self._filled_positions.passes(reading) else None
        if isinstance(reading, ImuReading):
            return self.imu_gate.measured(reading) if self.imu_gate.passes(reading) else None
        return reading
