"""`live`: shows and writes the shape while it moves, from boards, a recorded trial or the twin."""

from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from ..io.model_file import read_sensor_model
from ..io.reports.terminal import Terminal
from ..io.result import RUN_FILE
from ..io.toml import read_settings
from ..io.whole import check_replaceable, check_vacant
from ..live.feeds import Feed, boards_feed, replay_feed, twin_feed
from ..live.panel import OperatorAtTerminal, Panel, shown
from ..live.rig import Rig
from ..live.session import LiveResult, Session, stopped_by_signals
from ..models.sensor.sensor_model import SensorModel
from ..models.settings import Settings
from ..models.structure.shape import Shape
from ..models.values.errors import TensegraphError
from ..pipeline import Pipeline
from .record import report_recording


@dataclass(frozen=True, slots=True)
class LiveSource:
    """The choice of the source of readings: one of the boards of a rig, a recorded trial, or the twin of a plan.

    Raises:
        TensegraphError: when none or more than one is given, or an option does not apply to it.
    """

    rig: Path | None
    replay: Path | None
    twin: Path | None
    speed: float
    """Speed of a replay or a twin, relative to real time."""
    ports: tuple[str, ...]
    """Names of serial ports of a rig; see `Rig.plan`."""
    record: Path | None
    """Trial directory to record into, which must not exist yet."""

    def __post_init__(self) -> None:
        if sum(given is not None for given in (self.rig, self.replay, self.twin)) != 1:
            raise TensegraphError("expected one of --rig, --replay and --twin")
        if (self.rig is not None and self.speed != 1) or (self.rig is None and self.ports):
            raise TensegraphError("--speed goes with --replay and --twin, --port with --rig")

    @property
    def name(self) -> str:
        """Name for the result."""
        named = self.record or self.replay or (self.twin and self.twin.with_suffix(""))
        return named.resolve().name if named else "live"

    def feed(self, settings: Settings, model: SensorModel, terminal: Terminal) -> AbstractContextManager[Feed]:
        """Return the readings, as a context manager; see `boards_feed`, `replay_feed` and `twin_feed`."""
        if self.rig is not None:
            operator = OperatorAtTerminal(terminal)
            return boards_feed(Rig.read(self.rig), self.ports, self.record, settings, model, operator)
        if self.replay is not None:
            return replay_feed(self.replay, self.speed, self.record)
        assert self.twin is not None
        return twin_feed(self.twin, self.speed, self.record)


class ShapeView(Protocol):
    """A display of shapes."""

    def show(self, shape: Shape) -> None:
        """Show a shape."""
        ...


class NoView:
    """Shows nothing; used when no window is wanted."""

    def show(self, shape: Shape) -> None:
        """Show nothing."""


def show_live(
    source: LiveSource,
    *,
    out: Path | None,
    config: Path | None,
    model: Path | None,
    view: bool,
    seconds: float,
    terminal: Terminal,
) -> None:
    """Estimate until the source ends, `seconds` are over or Ctrl-C, and write the result.

    Args:
        source: source of the readings.
        out: result directory; named after the source if None.
        config: file of settings; defaults if None.
        model: sensor model; the one in the package if None.
        view: whether to show the shape in a window.
        seconds: duration; may be infinite.
        terminal: for the panel.

    Raises:
        TensegraphError: when the source cannot be read, or the result or the recording cannot be written.
    """
    settings = read_settings(config)
    sensor_model = read_sensor_model(model)
    path = out or Path("results") / source.name
    check_replaceable(path, RUN_FILE)
    if source.record is not None:
        check_vacant(source.record)
    with source.feed(settings, sensor_model, terminal) as feed:
        session = Session(feed, Pipeline(feed.description, settings, sensor_model), seconds)
        run_session(session, feed, path, window_of(session.pipeline) if view else nullcontext(NoView()), terminal)
    for fit in session.pipeline.own_frames.fits:
        terminal.line(f"frame of position {fit.recording}: {fit.text()}")
    terminal.written(f"written to {path}")
    if source.record is not None:
        report_recording(source.record, feed.state(), terminal)


def run_session(
    session: Session, feed: Feed, path: Path, view: AbstractContextManager[ShapeView], terminal: Terminal
) -> None:
    """Run a session to its end, on the screen and into a result directory."""
    pipeline = session.pipeline
    clocks = pipeline.boards.counts if pipeline.boards else []
    panel = Panel(
        f"live, from {feed.origin}; Ctrl-C ends it",
        session.activity,
        lambda: clocks,
        feed.state,
        lambda: pipeline.front_end.exchanged,
    )
    with LiveResult(path, pipeline.trial.structure, pipeline.settings) as result:
        with ExitStack() as stack:
            window = stack.enter_context(view)
            stack.enter_context(stopped_by_signals(feed.source))
            stack.enter_context(shown(panel, terminal.news))
            for shape in session.shapes():
                result.add(shape)
                window.show(shape)
        with terminal.stage("figures"):
            result.finish(f"{feed.name}, live", session.as_table(path))


def window_of(pipeline: Pipeline) -> AbstractContextManager[ShapeView]:
    """Return a window that shows a pipeline's shapes.

    Raises:
        TensegraphError: when there is no display to open it on.
    """
    from ..io.figures.live_view import LiveView  # pyplot takes a second to import

    return LiveView(pipeline.trial.structure, pipeline.rest.node_position_m, pipeline.settings.probability)
