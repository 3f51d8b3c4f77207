"""`live`: shows and writes the shape while it moves, from boards, a recorded trial or the twin."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from ..io.input_files import real_path
from ..io.publish.ros2_node import check_ros2, ros2_publisher
from ..io.publish.udp import UdpPublisher, udp_address
from ..io.reports.terminal import Terminal
from ..io.result import RESULT_FILES, SHAPE_FILE
from ..io.toml import read_settings
from ..io.viewer.server import ViewerServer
from ..io.whole import check_replaceable, check_vacant
from ..live.feeds import Feed, boards_feed, replay_feed, twin_feed
from ..live.panel import OperatorAtTerminal, Panel, shown
from ..live.rig import Rig
from ..live.session import LiveResult, Session, stopped_by_signals
from ..models.settings import Settings
from ..models.structure.shape import Shape
from ..models.values.errors import InputError, TensegraphError, naming
from ..pipeline import AnySensorModel, Pipeline
from .origin import check_trained, chosen_model, made_with
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
    seconds: float
    """Duration of the trial, from the start of the taring; may be infinite."""

    def __post_init__(self) -> None:
        if sum(given is not None for given in (self.rig, self.replay, self.twin)) != 1:
            raise TensegraphError("expected one of --rig, --replay and --twin")
        if (self.rig is not None and self.speed != 1) or (self.rig is None and self.ports):
            raise TensegraphError("--speed goes with --replay and --twin, --port with --rig")

    @property
    def name(self) -> str:
        """Name for the result, which replaces no other one; a session at the rig that is not recorded has its time."""
        if self.replay is not None and self.record is None:
            return f"{real_path(self.replay).name}_replayed"
        named = self.record or self.replay or (self.twin and self.twin.parent / self.twin.stem)
        return f"{real_path(named).name}_session" if named else time.strftime("session_%Y%m%d_%H%M%S")

    @contextmanager
    def feed(self, settings: Settings, model: AnySensorModel, terminal: Terminal) -> Iterator[Feed]:
        """Give the readings; see `boards_feed`, `replay_feed` and `twin_feed`."""
        with ExitStack() as stack:
            if self.rig is not None:
                operator = OperatorAtTerminal(terminal)
                rig = Rig.read(self.rig)
                feed = stack.enter_context(
                    boards_feed(rig, self.ports, self.record, settings, model, operator, self.seconds)
                )
            elif self.replay is not None:
                feed = stack.enter_context(replay_feed(self.replay, self.speed, self.record, self.seconds))
            else:
                assert self.twin is not None
                with terminal.stages(self.twin.stem, {"simulation": 1.0}) as bar:
                    simulated = partial(bar.reached, "simulation")
                    feed = stack.enter_context(twin_feed(self.twin, self.speed, self.record, simulated, self.seconds))
            yield feed


class ShapeSink(Protocol):
    """What takes shapes as they are estimated: a display, or another program."""

    def add(self, shape: Shape) -> None:
        """Take a shape."""
        ...


@dataclass(frozen=True, slots=True)
class LiveOutputs:
    """Where shapes go beside the result.

    Raises:
        InputError: for an address that is none, or of another machine, or without a library that publishing needs.
        TensegraphError: where there is no display for the window.
    """

    window: bool
    """Whether matplotlib shows them."""
    viewer: bool
    """Whether Rerun shows them."""
    publish: tuple[str, ...]
    """`ros2`, or addresses of UDP."""
    publish_remote: bool
    """Whether these may be of other machines."""

    def __post_init__(self) -> None:
        if self.window:
            from ..io.figures.live_view import check_window  # pyplot takes a second to import

            check_window()
        for address in self.publish:
            if address == "ros2":
                check_ros2()
            else:
                udp_address(address, remote=self.publish_remote)

    @contextmanager
    def page(self, terminal: Terminal) -> Iterator[ViewerServer | None]:
        """Serve the page of the viewer, if it is wanted, and print its address.

        Raises:
            TensegraphError: see `ViewerServer`.
        """
        if not self.viewer:
            yield None
            return
        with ViewerServer() as server:
            terminal.line(f"Open this address in a browser of this machine: {server.page_url}")
            yield server

    def sinks(self, pipeline: Pipeline, server: ViewerServer | None) -> Iterator[AbstractContextManager[ShapeSink]]:
        """Yield what takes a pipeline's shapes, context managers."""
        structure, rest_m, settings = pipeline.trial.structure, pipeline.rest.node_position_m, pipeline.settings
        for address in self.publish:
            if address == "ros2":
                yield ros2_publisher(structure, settings.probability, remote=self.publish_remote)
            else:
                yield UdpPublisher(address, structure, remote=self.publish_remote)
        if server is not None:
            from ..io.viewer.live_viewer import live_viewer  # matplotlib, whose colours it has

            yield live_viewer(server, structure, rest_m, settings)
        if self.window:
            from ..io.figures.live_view import live_window

            yield live_window(structure, rest_m, settings.probability)


def show_live(
    source: LiveSource,
    *,
    out: Path | None,
    config: Path | None,
    model: Path | None,
    outputs: LiveOutputs,
    terminal: Terminal,
) -> None:
    """Estimate until the source ends or Ctrl-C, and write the result.

    Args:
        source: source of the readings.
        out: result directory; in `results`, named after the source if None.
        config: file of settings; defaults if None.
        model: file or name of the sensor model; the one in the package if None.
        outputs: where shapes go beside the result.
        terminal: for the panel.

    Raises:
        TensegraphError: when the source cannot be read, or the result or the recording cannot be written.
    """
    terminal.outlive_the_screen()
    settings = read_settings(config)
    sensor_model = chosen_model(model)
    path = out or Path("results") / source.name
    check_replaceable(path, RESULT_FILES)
    if source.record is not None:
        check_vacant(source.record)
        record = real_path(source.record)
        if real_path(path) in (record, *record.parents) and not (path / SHAPE_FILE).exists():
            raise InputError(f"{path}: expected another place for the result than for the recording: add --out")
    with outputs.page(terminal) as server, source.feed(settings, sensor_model, terminal) as feed:
        with stopped_by_signals(feed.source), ExitStack() as stack:
            check_trained(sensor_model, feed.description, settings, config or model)
            parts = made_with("live", model, feed.plug_ins)
            try:
                with naming(feed.path, path):
                    session = Session(feed, Pipeline(feed.description, settings, sensor_model))
                    sinks = [stack.enter_context(sink) for sink in outputs.sinks(session.pipeline, server)]
                    run_session(session, feed, path, sinks, terminal, parts)
            except KeyboardInterrupt:
                terminal.error(f"{path}: not written: interrupted")
                if source.record is not None:
                    report_recording(source.record, feed.state(), terminal)
                raise
        for sink in sinks:
            if isinstance(sink, UdpPublisher) and sink.left_out:
                terminal.line(f"{sink.address}: {sink.left_out} shapes could not be sent")
    if skipped := session.activity.skipped_frames:
        hint = ": a lower --speed skips fewer" if source.speed > 1 else ""
        frames = skipped + session.activity.frames
        terminal.line(f"{skipped} of {frames} frames were skipped, which came faster than they were estimated{hint}")
    for fit in session.pipeline.aids.own_frames.fits:
        terminal.line(f"frame of position {fit.recording}: {fit.text()}")
    for name, text in session.pipeline.warnings().items():
        terminal.line(f"{name}: {text}")
    terminal.written(f"written to {path}")
    if source.record is not None:
        report_recording(source.record, feed.state(), terminal)


def run_session(
    session: Session,
    feed: Feed,
    path: Path,
    sinks: Sequence[ShapeSink],
    terminal: Terminal,
    parts: Mapping[str, Any],
) -> None:
    """Run a session to its end, on the screen, into a result directory and to all sinks; `parts` go into run.toml."""
    pipeline = session.pipeline
    panel = Panel(
        f"live, from {feed.origin}; Ctrl-C ends it",
        session.activity,
        feed.state,
        pipeline.boards.counts if pipeline.boards else [],
        pipeline,
    )
    with LiveResult(path, pipeline.trial.structure, pipeline.settings, terminal.error) as result:
        with shown(panel, terminal.news):
            for shape in session.shapes():
                if session.latency is not None:
                    result.add_latency(session.latency)
                for sink in (result, *sinks):
                    sink.add(shape)
        terminal.line(f"writing {path}: Ctrl-C once more gives it up")
        with terminal.stage("figures"):
            result.finish(f"{feed.name}, live", {**session.as_table(path), **parts})
