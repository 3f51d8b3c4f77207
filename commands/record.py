"""`record`: writes the rows of the boards to a trial directory."""

from collections.abc import Sequence
from pathlib import Path

from ..io.reports.terminal import Terminal
from ..io.toml import read_settings
from ..io.whole import check_vacant
from ..live.activity import Activity
from ..live.feeds import boards_feed
from ..live.panel import OperatorAtTerminal, Panel, shown
from ..live.rig import Rig
from ..live.session import stopped_by_signals
from ..models.values.errors import RecordingError
from ..models.values.link import LinkState
from ..models.values.readings import BoardReading
from .origin import chosen_model


def record_boards(
    rig: Path,
    out: Path,
    *,
    config: Path | None,
    model: Path | None,
    ports: Sequence[str],
    seconds: float,
    terminal: Terminal,
) -> None:
    """Record until `seconds` have passed or Ctrl-C is pressed.

    Args:
        rig: path of the description of the rig.
        out: trial directory, which must not exist yet.
        config: file of settings, of which those of the clocks count; defaults if None.
        model: file or name of the sensor model, from which motion during taring is computed; the one in the package
            if None.
        ports: see `Rig.plan`.
        seconds: duration from the start of the taring; may be infinite.
        terminal: for the panel.

    Raises:
        TensegraphError: when no board answers, the boards fall silent while the sensors are tared, the structure does
            not stand still, or the recording ended early.
    """
    terminal.outlive_the_screen()
    check_vacant(out)
    setup = Rig.read(rig)
    settings = read_settings(config)
    boards = setup.description.boards(settings.clock)
    operator = OperatorAtTerminal(terminal)
    sensor_model = chosen_model(model)
    with boards_feed(setup, ports, out, settings, sensor_model, operator, seconds, only_records=True) as feed:
        activity = Activity.of(len(setup.table.board), len(setup.table.imu))
        panel = Panel(f"recording {out}, Ctrl-C ends it", activity, feed.state, boards.counts)
        with stopped_by_signals(feed.source), shown(panel, terminal.news):
            for row in feed.rows:
                activity.count(row, feed.source.late_s())
                if isinstance(row, BoardReading):
                    boards.reading(row)  # updates the counts of the clocks
    report_recording(out, feed.state(), terminal)


def report_recording(path: Path, state: LinkState, terminal: Terminal) -> None:
    """Print how many rows were recorded.

    Raises:
        RecordingError: when the recording ended early.
    """
    if state.recording_error:
        raise RecordingError(state.recording_error)
    terminal.written(f"{state.recorded_rows} rows recorded in {path}")
