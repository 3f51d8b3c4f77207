"""The boards of a rig from Python: `tensegraph.Boards`."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from ..io.whole import check_vacant
from ..models.settings import Settings, checked_settings
from ..models.structure.shape import Shape
from ..models.trial_description import TrialDescription
from ..models.values.errors import RecordingError, TensegraphError
from ..models.values.readings import Reading
from ..pipeline import AnySensorModel, Pipeline, sensor_model_of

if TYPE_CHECKING:
    from .feeds import Feed


class Boards:
    """The live rig as an iterator of shapes.

        if __name__ == "__main__":  # the boards are read in another process, which imports the script again
            with tg.Boards("rig.toml") as boards:
                for shape in boards:
                    print(shape.t_s, shape.node_position_m[8])

    On entry the ports are opened and the sensors tared, for which the structure has to stand still; on exit the ports
    are closed, and a recording is complete.

    Args:
        rig: path of rig.toml.
        ports: serial ports; those of the rig, or every USB serial port, if none are given.
        record: trial directory to record into, which must not exist yet; nothing is recorded if None.
        settings: the settings of the run; the defaults if None.
        model: the sensor model, or the name of one of another package; the one that ships with the package if None.
        say: function that is given each message to the operator.

    Raises:
        TensegraphError: on entry, when the rig or the model cannot be read, something stands where to record, no board
            answers, the boards fall silent while they are tared, or the structure does not stand still; on exit, when
            the recording ended early, as on a full disk.
    """

    def __init__(
        self,
        rig: str | Path,
        *,
        ports: Sequence[str] = (),
        record: str | Path | None = None,
        settings: Settings | None = None,
        model: AnySensorModel | str | None = None,
        say: Callable[[str], None] = print,
    ) -> None:
        self._rig = Path(rig)
        self._ports = tuple(ports)
        self._record = None if record is None else Path(record)
        self._settings = checked_settings(settings)
        self._model = model
        self._say = say
        self._open = ExitStack()
        self._feed: Feed | None = None
        self._shapes: Iterator[Shape] | None = None
        self.skipped_frames = 0
        """Number of frames so far that no shape was estimated of, because the loop took longer than they did."""

    def __enter__(self) -> Self:
        from .feeds import boards_feed  # pyserial, which nothing else of the public names needs
        from .rig import Rig

        if self._record is not None:
            check_vacant(self._record)
        self._model = model = sensor_model_of(self._model)
        feed = boards_feed(Rig.read(self._rig), self._ports, self._record, self._settings, model, _Listener(self._say))
        self._feed = self._open.enter_context(feed)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        feed, self._feed, self._shapes = self._feed, None, None
        self._open.close()
        if error is None and feed is not None and feed.state().recording_error:
            raise RecordingError(feed.state().recording_error)

    def __iter__(self) -> Iterator[Shape]:
        """Yield the shape of every frame as soon as the frame is complete, until `stop`.

        To a loop that falls behind by 0.1 s the newest is given next, as on the screen of `tensegraph live`.
        """
        if self._shapes is None:
            self._shapes = self._newest_shapes()
        return self._shapes

    def _newest_shapes(self) -> Iterator[Shape]:
        from .activity import Activity, NewestFrames

        pipeline = Pipeline(self.description, self._settings, sensor_model_of(self._model))
        activity = Activity.of(len(self.description.tendons_of_board), len(self.description.imus))
        frames = NewestFrames(self._opened.source, activity).select(pipeline.lengths(self.readings()))
        for shape in pipeline.shapes(frames, "live"):
            self.skipped_frames = activity.skipped_frames
            yield shape

    def readings(self) -> Iterator[Reading]:
        """Yield the rows of the boards and the samples of their inertial sensors instead, for `tensegraph.stream`."""
        return self._opened.rows

    @property
    def description(self) -> TrialDescription:
        """What is known of the trial before its first reading."""
        return self._opened.description

    def stop(self) -> None:
        """Stop reading; what has arrived is still yielded."""
        self._opened.source.stop()

    @property
    def _opened(self) -> "Feed":
        if self._feed is None:
            raise TensegraphError("Boards: expected 'with tensegraph.Boards(...) as boards:', got boards not entered")
        return self._feed


class _Listener:
    """An operator who is told what to do and does it."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self.say = say

    def ask_for_rest(self, seconds: float) -> None:
        """Say for how long the structure has to stand still."""
        self.say(f"taring for {seconds:g} s: leave the structure alone, standing at its rest shape ...")
