"""The moving shape as a film: MP4, or GIF."""

import errno
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from ...models.sensor.frames import LONGEST_SILENCE_S
from ...models.structure.reconstruction import Reconstruction
from ...models.values.errors import needs_extra
from .structure_view import StructureDrawing
from .style import set_cube

FRAMES_PER_S = 12.5
"""Of a film, in the run's own time; drawing a picture takes 0.1 s."""
SIDE_INCH, DOTS_PER_INCH = 6.4, 100


def write_film(result: Reconstruction, probability: float, path: Path) -> None:
    """Write the run in real time, seen from one place, with the ellipsoids.

    Args:
        result: the run.
        probability: of the ellipsoids.
        path: of the file, which ends in .mp4 or .gif.

    Raises:
        InputError: when MP4 is asked for, and imageio-ffmpeg is not installed.
        OSError: when the film cannot be written whole.
    """
    if path.suffix == ".gif":
        pictures = (Image.fromarray(picture) for picture in _pictures(result, probability))
        first = next(pictures)
        first.save(path, save_all=True, append_images=pictures, duration=round(1e3 / FRAMES_PER_S), loop=0)
        return
    with needs_extra("MP4", "video"):
        import imageio_ffmpeg
    side = round(SIDE_INCH * DOTS_PER_INCH)
    options = {"fps": FRAMES_PER_S, "quality": 7, "ffmpeg_log_level": "quiet"}
    try:
        with closing(imageio_ffmpeg.write_frames(str(path), (side, side), **options)) as writer:
            writer.send(None)  # starts it
            for picture in _pictures(result, probability):
                writer.send(picture.tobytes())
        imageio_ffmpeg.count_frames_and_secs(str(path))  # what writes it tells nobody that it could not end it
    except (OSError, RuntimeError) as error:
        raise OSError(errno.ENOSPC, "the film is not whole: is the disk full?") from error


def film_times_s(t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (pictures,) times of a film of a run with frames at (frames,) times.

    A silence without frames, longer than `LONGEST_SILENCE_S`, is passed over, as in a replay.
    """
    parts = np.split(t_s, np.flatnonzero(np.diff(t_s) > LONGEST_SILENCE_S) + 1)
    return np.concatenate([_evenly_s(part) for part in parts])


def _evenly_s(t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.minimum(np.arange(t_s[0], t_s[-1] + 1e-9, 1 / FRAMES_PER_S), t_s[-1]))


def _pictures(result: Reconstruction, probability: float) -> Iterator[NDArray[np.uint8]]:
    """Yield (height, width, 3) pictures."""
    figure = Figure(figsize=(SIDE_INCH, SIDE_INCH), dpi=DOTS_PER_INCH, layout="constrained")
    canvas: Any = FigureCanvasAgg(figure)  # whose methods have no types
    drawing = StructureDrawing(figure, result.structure, result.node_position_m[0], probability)
    set_cube(drawing.axis, 1e3 * result.node_position_m.reshape(-1, 3), 0.52)
    for t_s in film_times_s(result.t_s):
        drawing.move(result[float(t_s)])
        canvas.draw()
        figure.set_layout_engine("none")  # the first picture's layout is kept: to find it takes a fifth of the time
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()
