"""One run in a recording of Rerun: its frames, added at once or as they are estimated, on the timeline `t_s`."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.settings import Settings
from ...models.structure.reconstruction import Reconstruction
from ...models.structure.structure import Structure
from ...models.values.errors import needs_extra
from ...models.values.tracks import StampedPositions
from .curves import curve_columns, curve_styles, status_changes
from .scene import ghost_columns, rest_lines, space_columns

APPLICATION = "tensegraph"
"""By this name Rerun keeps what a user changes on the screen."""
TIMELINE = "t_s"
FRAMES_AT_ONCE = 1000
"""Number of frames that are sent together, to bound the memory."""


def new_recording() -> Any:
    """Return a recording of Rerun, which goes nowhere yet.

    Raises:
        InputError: when Rerun is not installed.
    """
    with needs_extra("Rerun", "rerun"):
        import rerun
    return rerun.RecordingStream(APPLICATION)


class RunLog:
    """One run in a recording, under a root of its own; frames are added in order of time.

    Entities are `ROOT/FRAME/rods`, `tendons` and so on in space, where FRAME is the coordinate frame, and
    `ROOT/length_m/TENDON`, `ROOT/sigma_m`, `ROOT/innovation` and `ROOT/status` over time.
    """

    def __init__(
        self, recording: Any, structure: Structure, coordinate_frame: str, settings: Settings, name: str = ""
    ) -> None:
        """Log what does not change.

        Args:
            recording: see `new_recording`.
            structure: rods, tendons and anchors.
            coordinate_frame: see `Reconstruction.coordinate_frame`.
            settings: with the probability of the ellipsoids and the threshold of loads.
            name: the root of the run among several; empty for one alone.
        """
        import rerun

        self._rerun = rerun
        self._recording = recording
        self._settings = settings
        self._status = ""
        self.name = name
        self.structure = structure
        self.root = f"/{rerun.escape_entity_path_part(name)}" if name else ""
        self.space = f"{self.root}/{coordinate_frame}"
        recording.log(self.space, rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for entity, style in curve_styles(rerun, structure).items():
            recording.log(f"{self.root}/{entity}", style, static=True)

    def add_rest(self, node_position_m: NDArray[np.float64]) -> None:
        """Add (nodes, 3) the rest shape, which is seen at all times."""
        lines = rest_lines(self._rerun, self.structure, node_position_m)
        self._recording.log(f"{self.space}/rest", lines, static=True)

    def add_truth(self, positions: StampedPositions) -> None:
        """Add the true shapes, as a ghost."""
        columns = ghost_columns(self._rerun, self.structure, positions.node_position_m)
        self._send(f"{self.space}/truth", positions.t_s, columns)

    def add(self, result: Reconstruction) -> None:
        """Add the next frames of the run."""
        for first in range(0, len(result), FRAMES_AT_ONCE):
            until_s = result.t_s[first + FRAMES_AT_ONCE] if first + FRAMES_AT_ONCE < len(result) else None
            self._add_part(result[result.t_s[first] : until_s])

    def _add_part(self, part: Reconstruction) -> None:
        settings = self._settings
        space = space_columns(self._rerun, part, settings.probability, settings.load_threshold_n)
        self._send(self.space, part.t_s, space)
        self._send(self.root, part.t_s, curve_columns(self._rerun, part))
        changed_s, texts = status_changes(part, self._status)
        if texts:
            self._send(self.root, changed_s, {"status": self._rerun.StateChange.columns(state=texts)})
            self._status = texts[-1]

    def _send(self, place: str, t_s: NDArray[np.float64], columns: dict[str, Any]) -> None:
        times = [self._rerun.TimeColumn(TIMELINE, duration=t_s)]
        for entity, values in columns.items():
            self._recording.send_columns(f"{place}/{entity}", times, values)
