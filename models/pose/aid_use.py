"""Whether other sensors are used: a recording of which nothing or little is used is told, with the likely cause.

Why samples of an inertial sensor that are of the time of the frames are not used, `ImuGate` tells.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..structure.shape import Shape
from ..values.aids import AidReading, ImuReading, PositionReading, RangeReading

Kind = Literal["imu", "range", "position"]

OLD_S = 1.0
"""Age of a reading from which it tells nothing of its frame; and time after which a recording without any is told."""
LEAST_IN_TIME = 0.1
"""Share of a recording that is of the time of the frames, below which its clock looks like another one."""
MOST_RATIO = 2.0
"""Ratio of what is read to what is expected, or its inverse, from which the unit looks wrong."""


@dataclass(slots=True)
class _ReadAndUsed:
    """What was read of one recording, and how much of it was used."""

    read: int = 0
    first_s: float = np.nan
    last_s: float = np.nan
    in_time: int = 0
    """Number of those that are of the time of a frame."""
    outlying: int = 0
    """Number of those that were left out of it."""
    silent_frames: int = 0
    """Number of frames for which none had come for longer than `OLD_S`."""
    ratios: list[float] = field(default_factory=list)
    """Of each reading of one instant: the range, or the distance from the first node, to that at rest."""


class AidUse:
    """Counts what is read and used of each inertial sensor and recording of ranges or positions in the world."""

    def __init__(
        self, rest_m: NDArray[np.float64], imus: int, ranges: int, positions: Sequence[int], *, is_held: bool
    ) -> None:
        """Begin with nothing read.

        Args:
            rest_m: (nodes, 3) the rest shape.
            imus: number of inertial sensors.
            ranges: number of recordings of ranges.
            positions: the numbers of the recordings of positions in the world.
            is_held: whether anchors hold the structure, so that neither ranges nor positions are used.
        """
        self._rest_m = rest_m
        self._is_held = is_held
        numbers: list[tuple[Kind, int]] = [("imu", number) for number in range(imus)]
        numbers += [("range", number) for number in range(ranges)]
        numbers += [("position", number) for number in positions]
        self._recordings = {number: _ReadAndUsed() for number in numbers}
        self._reference: dict[int, PositionReading] = {}
        self._span_s = (np.nan, np.nan)
        self._frames = 0

    def count_frame(self, t_s: float) -> None:
        """Count which recordings are silent in one more frame; all readings up to its time have been read."""
        self._frames += 1
        for recording in self._recordings.values():
            recording.silent_frames += not t_s - recording.last_s <= OLD_S

    def counts(self) -> dict[str, int]:
        """Return in how many frames each recording was silent; `ImuGate` counts those of inertial sensors."""
        used = {} if self._is_held else self._recordings
        return {f"{kind} {n}: silent frames": one.silent_frames for (kind, n), one in used.items() if kind != "imu"}

    def read(self, reading: AidReading) -> None:
        """Count a reading that has arrived, as it was recorded."""
        recording = self._of(reading)
        if recording is None:
            return
        recording.first_s = reading.t_s if recording.read == 0 else recording.first_s
        recording.last_s = reading.t_s
        recording.read += 1
        if len(recording.ratios) < len(self._rest_m):
            recording.ratios += self._ratio(reading)

    def observe(self, shape: Shape) -> Shape:
        """Count what a shape was estimated from, and return it."""
        self._span_s = (float(np.fmin(self._span_s[0], shape.t_s)), shape.t_s)
        for reading in shape.lengths.aids if not self._is_held else ():
            recording = self._of(reading)
            if recording is not None and shape.t_s - reading.t_s < OLD_S:
                recording.in_time += 1
        for number in shape.outlying_ranges:
            self._recordings["range", number].outlying += 1
        return shape

    def lines(self) -> dict[str, str]:
        """Return of each recording of which nothing or little was used why that is so, by its name."""
        first_s, last_s = self._span_s
        if not last_s - first_s > OLD_S:
            return {}
        lines = {
            f"{kind} {number}": self._out_of_time(kind, one) if one.in_time > one.outlying else self._unused(kind, one)
            for (kind, number), one in self._recordings.items()
        }
        return {name: line for name, line in lines.items() if line}

    def _out_of_time(self, kind: Kind, recording: _ReadAndUsed) -> str:
        """Return what is told of a recording in use that is of another time than most frames; empty where it is not."""
        if kind == "imu":
            return ""
        first_s, last_s = self._span_s
        if recording.in_time < LEAST_IN_TIME * recording.read:
            late = f"{recording.read - recording.in_time} of {recording.read} readings"
            its = f"{recording.first_s:.2f} to {recording.last_s:.2f} s"
            return f"{late}, {its}, are not of the time of the frames, {first_s:.2f} to {last_s:.2f} s: is t_s in s?"
        if recording.silent_frames > (1 - LEAST_IN_TIME) * self._frames:
            silent = f"no reading for {recording.silent_frames} of {self._frames} frames"
            return f"{silent}, the last at {recording.last_s:.2f} s: does it end, or is t_s not in s?"
        return ""

    def _unused(self, kind: Kind, recording: _ReadAndUsed) -> str:
        """Return what is told of a recording of which nothing was used; empty where that is told elsewhere."""
        cause = self._cause(kind, recording)
        return f"no reading used: {cause}" if cause else ""

    def _cause(self, kind: Kind, recording: _ReadAndUsed) -> str:
        """Return why nothing of a recording was used; empty where that is told elsewhere."""
        first_s, last_s = self._span_s
        is_of_the_time = first_s - OLD_S < recording.first_s <= last_s
        if kind == "imu" and is_of_the_time:
            return ""
        if kind != "imu" and self._is_held:
            return "anchors hold the structure where they are"
        if recording.read == 0:
            return "none has come"
        if not is_of_the_time:
            frames = f"the time of the frames, {first_s:.2f} to {last_s:.2f} s"
            return f"none is of {frames}, its first is at {recording.first_s:.2f} s: is t_s of the same clock?"
        ratio = float(np.median(recording.ratios)) if recording.ratios else 1.0
        if not 1 / MOST_RATIO < ratio < MOST_RATIO:
            times = np.format_float_positional(ratio, precision=2, fractional=False, trim="-")
            return f"distances are {times} times those expected: are all units m?"
        return f"all {recording.read} contradict the robot: are frame, axes, beacons and nodes told right?"

    def _of(self, reading: AidReading) -> _ReadAndUsed | None:
        """Return the recording of a reading; None of what is not counted."""
        if isinstance(reading, ImuReading):
            return self._recordings["imu", reading.imu]
        if isinstance(reading, RangeReading):
            return self._recordings["range", reading.pair[0]]
        return self._recordings.get(("position", reading.recording))

    def _ratio(self, reading: AidReading) -> list[float]:
        """Return the distance that a reading tells over that at rest; nothing where it tells none."""
        if isinstance(reading, RangeReading):
            at_rest_m = float(np.linalg.norm(self._rest_m[reading.node] - reading.beacon_position_m))
            return [reading.range_m / at_rest_m] if at_rest_m > 0 else []
        if not isinstance(reading, PositionReading):
            return []
        first = self._reference.setdefault(reading.recording, reading)
        if first.node == reading.node:
            return []
        at_rest_m = float(np.linalg.norm(self._rest_m[reading.node] - self._rest_m[first.node]))
        return [float(np.linalg.norm(reading.position_m - first.position_m) / at_rest_m)]
