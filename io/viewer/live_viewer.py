"""The shapes of a live session in the viewer Rerun, as they are estimated."""

import time
from multiprocessing.queues import Queue

import numpy as np
from numpy.typing import NDArray

from ...models.settings import Settings
from ...models.structure.reconstruction import Reconstruction
from ...models.structure.shape import Shape
from ...models.structure.structure import Structure
from .first_screen import first_screen
from .run_log import RunLog, new_recording
from .server import ViewerServer
from .shape_process import ShapeProcess, arrived_shapes

SEND_S = 0.2
"""Time between two sendings. One costs the same whether it holds one frame or ten, half a frame's time at 50 Hz."""
WAITING_SHAPES = 100
"""Largest number of shapes that wait for a sending, two seconds at 50 Hz."""


def live_viewer(
    server: ViewerServer, structure: Structure, rest_position_m: NDArray[np.float64], settings: Settings
) -> ShapeProcess:
    """Return a process that sends shapes to the viewer, a context manager; shapes are left out where it lags."""
    return ShapeProcess(_send, server.data_url, structure, rest_position_m, settings, waiting=WAITING_SHAPES)


def _send(
    shapes: "Queue[Shape]",
    data_url: str,
    structure: Structure,
    rest_position_m: NDArray[np.float64],
    settings: Settings,
) -> None:
    """Send shapes as they arrive, several times a second."""
    recording = new_recording()
    recording.connect_grpc(data_url)
    run: RunLog | None = None
    for arrived in arrived_shapes(shapes, SEND_S):
        if not arrived:
            continue
        part = Reconstruction.of(structure, arrived)
        if run is None:  # the first shape tells the coordinate frame
            run = RunLog(recording, structure, part.coordinate_frame, settings)
            run.add_rest(rest_position_m)
            recording.send_blueprint(first_screen([run], follow=True))
        run.add(part)
        time.sleep(SEND_S)
