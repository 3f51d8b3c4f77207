"""The status panel, and the questions to the operator at the rig."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ..io.reports.terminal import Terminal
from ..models.sensor.clock import ClockCounts
from ..models.values.link import LinkState
from ..models.values.readings import SENSOR_FLAGS, Flag
from ..pipeline import Pipeline
from .activity import Activity, Arrivals


class Panel:
    """The state of a session, evaluated whenever rich draws the panel; a recording has no pipeline.

    What is wrong comes first, and then the estimate: a small terminal shows what fits in from the top.
    """

    def __init__(
        self,
        title: str,
        activity: Activity,
        state: Callable[[], LinkState],
        clocks: Sequence[ClockCounts],
        pipeline: Pipeline | None = None,
    ) -> None:
        self._title = title
        self._activity = activity
        self._state = state
        self._clocks = clocks
        self._pipeline = pipeline

    def __rich__(self) -> RenderableType:
        activity = self._activity
        state = self._state()
        complaints, pipeline = [*_complaints(activity, state)], self._pipeline
        if pipeline is None:
            summary = _summary(activity, state, {}, ())
        else:
            unsensed = pipeline.trial.structure.unsensed.tolist()
            summary = _summary(activity, state, pipeline.aid_counts(), unsensed)
            complaints += [f"{name}: {text}" for name, text in pipeline.rest_complaints()]
            complaints += [f"{aid}: {warning}" for aid, warning in pipeline.warnings().items()]
        parts: list[RenderableType] = [Text(complaint, style="red") for complaint in complaints]
        parts.append(summary)
        if activity.boards:
            parts.append(_boards(activity, self._clocks, state))
        if activity.imus:
            parts.append(_imus(activity, state))
        return Group(self._title, *parts)


@contextmanager
def shown(panel: Panel, console: Console) -> Iterator[None]:
    """Draw a panel twice a second; without a terminal, once at the end."""
    with Live(panel, console=console, refresh_per_second=2):
        yield
    if not console.is_terminal:
        console.line()


class OperatorAtTerminal:
    """An operator who reads the screen and presses Enter; without a keyboard, nothing is asked."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal

    def say(self, text: str) -> None:
        """Print a line."""
        self._terminal.line(text)

    def ask_for_rest(self, seconds: float) -> None:
        """Wait until Enter is pressed, if standard input is a terminal."""
        if sys.stdin is not None and sys.stdin.isatty():  # it is None where it was closed
            self._terminal.questions.input("Leave the structure alone, standing at its rest shape, and press Enter: ")
        self.say(f"taring for {seconds:g} s: it has to stand still ...")


def _complaints(activity: Activity, state: LinkState) -> list[str]:
    """Return what is wrong with ports, boards, inertial sensors and the recording."""
    complaints = [f"{port.port}: {port.complaint}" for port in state.ports if port.complaint]
    for port in state.ports:
        for sensor in port.unused_sensors:
            complaints.append(f"{port.port}: inertial sensor {sensor} is not in the rig: its samples are left out")
    for board, arrivals in enumerate(activity.boards):
        if arrivals.is_silent():
            complaints.append(f"board {board}: no row {_since(arrivals)}: its sensors are missing")
    for imu, arrivals in enumerate(activity.imus):
        if arrivals.is_silent():
            complaints.append(f"imu {imu}: no sample {_since(arrivals)}: nothing is taken from it")
    return complaints + ([state.recording_error] if state.recording_error else [])


def _since(arrivals: Arrivals) -> str:
    return f"for {arrivals.age_s():.0f} s" if arrivals.count else "yet"


def _boards(activity: Activity, clocks: Sequence[ClockCounts], state: LinkState) -> Table:
    boards = activity.boards
    table = Table("", *(f"board {board}" for board in range(len(boards))))
    ports_of_board = [[port for port in state.ports if port.board == board] for board in range(len(boards))]
    connected = [", ".join(port.port for port in ports if port.connected) or "-" for ports in ports_of_board]
    if state.ports:
        table.add_row("port", *connected)
    table.add_row("rate", *(f"{arrivals.rate_hz():.1f} Hz" for arrivals in boards))
    table.add_row("newest reading", *(_age(arrivals.age_s()) for arrivals in boards))
    for name in ("rows", "lost_rows", "dropped_rows", "restarts"):
        table.add_row(name.replace("_", " "), *(str(getattr(clock, name)) for clock in clocks))
    if state.ports:
        table.add_row("bad CRC", *(str(sum(port.counts.bad_crc for port in ports)) for ports in ports_of_board))
        table.add_row("garbage", *(str(sum(port.counts.garbage for port in ports)) for ports in ports_of_board))
    return table


def _imus(activity: Activity, state: LinkState) -> Table:
    imus = activity.imus
    table = Table("", *(f"imu {imu}" for imu in range(len(imus))))
    table.add_row("rate", *(f"{arrivals.rate_hz():.1f} Hz" for arrivals in imus))
    table.add_row("newest sample", *(_age(arrivals.age_s()) for arrivals in imus))
    table.add_row("samples", *(str(arrivals.count) for arrivals in imus))
    for name in ("lost_samples", "dropped_samples") if state.imus else ():
        table.add_row(name.replace("_", " "), *(str(getattr(counts, name)) for counts in state.imus))
    return table


def _age(age_s: float) -> str:
    if np.isinf(age_s):
        return "none yet"
    return f"{1e3 * age_s:.0f} ms ago" if age_s < 10 else f"{age_s:.0f} s ago"


def _summary(activity: Activity, state: LinkState, aid_counts: Mapping[str, int], unsensed: Sequence[int]) -> Table:
    table = Table(show_header=False)
    table.add_row("time", f"{time.perf_counter() - activity.started_s:.0f} s")
    if state.recorded_rows:
        table.add_row("recorded", f"{state.recorded_rows} rows")
    if activity.shape is not None:
        median_ms, p99_ms = activity.latency_ms()
        table.add_row("frames", f"{activity.frames}")
        told = f"median {median_ms:.1f} ms, 99 % within {p99_ms:.1f} ms, from last byte to shape"
        table.add_row("latency", told if activity.latency_s else "none yet")
        sigma_m = activity.shape.node_sigma_m
        table.add_row("largest sigma", f"{1e3 * sigma_m.max():.1f} mm, node {int(np.argmax(sigma_m))}")
        if activity.shape.doubt is not None:
            table.add_row(f"doubt {activity.shape.doubt}", activity.shape.doubt.advice)
        table.add_row("status so far", activity.states_so_far())
        table.add_row("flagged", _flagged(activity.shape.lengths.flags, unsensed) or "none")
    if activity.skipped_frames or state.skipped_rows:
        table.add_row("skipped", f"{activity.skipped_frames} frames, {state.skipped_rows} rows")
    for name, count in aid_counts.items():
        table.add_row(name, str(count))
    return table


def _flagged(flags: NDArray[np.int64], unsensed: Sequence[int]) -> str:
    """Return the sensors that are flagged now, grouped by flag."""
    kinds: dict[str, list[str]] = {}
    for tendon in np.setdiff1d(np.flatnonzero(flags & SENSOR_FLAGS), unsensed):
        kinds.setdefault(Flag(int(flags[tendon]) & SENSOR_FLAGS).names(), []).append(str(tendon))
    return "; ".join(f"{', '.join(tendons)}: {kind}" for kind, tendons in kinds.items())
