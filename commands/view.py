"""`view`: shows results in the viewer Rerun, side by side, with the truth where the trial has it."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..io.reports.terminal import Terminal
from ..io.stored_result import load, read_run, settings_of
from ..io.viewer.first_screen import first_screen, liveliest_tendon
from ..io.viewer.run_log import RunLog, new_recording
from ..io.viewer.server import ViewerServer
from ..models.settings import Settings
from ..models.structure.reconstruction import Reconstruction
from ..models.values.errors import TensegraphError
from ..models.values.tracks import StampedPositions
from ..pipeline import rest_shape_of_trial
from ..scoring.run_score import truth_of_trial
from .evaluate import trial_of
from .paths import distinct_names


@dataclass(frozen=True, slots=True, eq=False)
class ViewedResult:
    """A result with what its trial tells beside it."""

    name: str
    result: Reconstruction
    settings: Settings
    rest_position_m: NDArray[np.float64] | None
    """(nodes, 3); None where the trial cannot be read."""
    truth: StampedPositions | None
    """None where the trial has none."""


def view_results(paths: Sequence[Path], terminal: Terminal) -> None:
    """Show results until Ctrl-C.

    Args:
        paths: result directories.
        terminal: for the address of the page.

    Raises:
        TensegraphError: when a result cannot be read, two have the same name, or Rerun is missing or does not start.
    """
    names = distinct_names(paths)
    recording = new_recording()
    shown = [read_viewed(path, name, terminal) for path, name in zip(paths, names, strict=True)]
    with suppress(KeyboardInterrupt), ViewerServer() as server:
        recording.connect_grpc(server.data_url)
        runs = [_run_log(viewed, recording, viewed.name if len(shown) > 1 else "") for viewed in shown]
        recording.send_blueprint(first_screen(runs, liveliest_tendon(shown[0].result)))
        for run, viewed in zip(runs, shown, strict=True):
            with terminal.stage(f"sending {viewed.name}"):
                run.add(viewed.result)
        recording.flush()
        recording.disconnect()  # Rerun keeps what it got
        terminal.line("Open this address in a browser of this machine; Ctrl-C ends it:")
        terminal.written(server.page_url)
        server.wait()


def read_viewed(path: Path, name: str, terminal: Terminal) -> ViewedResult:
    """Read a result, its rest shape and its truth; say it where the latter two cannot be shown.

    Raises:
        InputError: when it is no result, or a table cannot be read.
    """
    run = read_run(path)
    settings = settings_of(run, path)
    with terminal.stage(f"reading {path}"):
        result = load(path)
    rest_m = truth = None
    try:
        trial = trial_of(run, path, None)
        rest_m = rest_shape_of_trial(trial, settings).node_position_m
        if trial.table.truth is not None and result.coordinate_frame != "body":
            known = truth_of_trial(trial, None, result, None)
            truth = _at_frames(StampedPositions(known.t_s, known.node_position_m), result.t_s)
    except TensegraphError as error:
        without = "the truth" if rest_m is not None else "rest shape and truth"
        terminal.line(f"{path}: shown without {without}: {error}")
    return ViewedResult(name, result, settings, rest_m, truth)


def _at_frames(truth: StampedPositions, t_s: NDArray[np.float64]) -> StampedPositions:
    """Return the true shape that is nearest to each frame, at its own time: a capture may have ten times as many."""
    halfway_s = 0.5 * (truth.t_s[1:] + truth.t_s[:-1])
    nearest = np.unique(np.searchsorted(halfway_s, t_s))
    return StampedPositions(truth.t_s[nearest], truth.node_position_m[nearest])


def _run_log(viewed: ViewedResult, recording: object, root: str) -> RunLog:
    """Return the log of a result, with its rest shape and truth."""
    result = viewed.result
    run = RunLog(recording, result.structure, result.coordinate_frame, viewed.settings, root)
    if viewed.rest_position_m is not None:
        run.add_rest(viewed.rest_position_m)
    if viewed.truth is not None:
        run.add_truth(viewed.truth)
    return run
