"""A run as a recording of the viewer Rerun, as `view` shows it."""

from pathlib import Path

from ...models.settings import Settings
from ...models.structure.reconstruction import Reconstruction
from ..viewer.first_screen import first_screen, liveliest_tendon
from ..viewer.run_log import RunLog, new_recording


def write_rerun(result: Reconstruction, probability: float, path: Path) -> None:
    """Write what `RunLog` logs of a run, and the first screen.

    Args:
        result: the run.
        probability: of the ellipsoids.
        path: of the file.

    Raises:
        InputError: when Rerun is not installed.
    """
    recording = new_recording()
    recording.save(path)
    run = RunLog(recording, result.structure, result.coordinate_frame, Settings(probability=probability))
    run.add(result)
    recording.send_blueprint(first_screen([run], liveliest_tendon(result)))
    recording.flush()
    recording.disconnect()
