"""The panel of a live session names what is wrong."""

import re
import sys
from dataclasses import replace
from io import StringIO

import numpy as np
from rich.console import Console
from rich.live import Live

from tensegraph import Settings, open_trial
from tensegraph.io.reports.terminal import Terminal
from tensegraph.live.activity import Activity
from tensegraph.live.panel import OperatorAtTerminal, Panel
from tensegraph.models.values.link import ImuCounts, LinkState, PortState
from tensegraph.models.values.readings import Flag
from tensegraph.pipeline import Pipeline


def shown(activity: Activity, pipeline: Pipeline) -> str:
    """Return the panel as text."""
    console = Console(width=200, record=True, file=StringIO())
    console.print(Panel("live", activity, LinkState, [], pipeline))
    return console.export_text()


def test_recordings_of_which_nothing_is_used_are_named(example, model, loaded) -> None:
    description = replace(open_trial(example).description, beacon_position_m=np.array([[1.0, 0, 0]]))
    pipeline = Pipeline(description, Settings(), model)
    for shape in loaded:
        pipeline.aids.use.observe(shape)
    assert "range 0: no reading used: anchors hold the structure" in shown(Activity.of(0, 0), pipeline)


def test_geometry_that_was_told_wrongly_is_named(example, model) -> None:
    """Anchors that are elsewhere; the same text as in the table of a recorded trial."""
    pipeline = Pipeline(open_trial(example).description, Settings(), model)
    assert "geometry" not in shown(Activity.of(0, 0), pipeline)
    pipeline.rest = replace(pipeline.rest, wrong=("anchors",))
    assert "geometry: the anchors are elsewhere than trial.toml says" in shown(Activity.of(0, 0), pipeline)


def test_a_tendon_without_a_sensor_is_not_flagged(example, model, loaded) -> None:
    loaded.flags[0, [5, 7, 11]] = int(Flag.MISSING)
    activity = Activity.of(0, 0)
    activity.shape = loaded[0.0]
    description = open_trial(example).description
    unsensed = replace(description, structure=replace(description.structure, unsensed=np.array([5, 11])))
    assert re.search(r"flagged +│ 7: missing", shown(activity, Pipeline(unsensed, Settings(), model)))


def test_a_small_terminal_shows_what_is_wrong_and_the_status(example, model, loaded) -> None:
    """Rich shows the first 23 lines of a terminal with 24; two boards with inertial sensors need 35."""
    activity = Activity.of(2, 2)
    for shape in loaded:
        activity.show(shape)
    pipeline = Pipeline(open_trial(example).description, Settings(), model)
    ports = (PortState("/dev/ttyACM0", 0, connected=True), PortState("/dev/ttyACM1", complaint="the device is gone"))
    state = LinkState(ports, (ImuCounts(), ImuCounts()), recording_error="first: the recording ended: disk full")
    console = Console(width=80, height=24, force_terminal=True, color_system=None, file=StringIO())
    with Live(Panel("live", activity, lambda: state, pipeline.boards.counts, pipeline), console=console) as live:
        live.refresh()
        drawn = console.file.getvalue()
    assert "the device is gone" in drawn
    assert "the recording ended: disk full" in drawn
    assert re.search(r"status so far +│ ok 100.0%", drawn)
    assert "garbage" not in drawn


def test_without_standard_input_nothing_is_asked(monkeypatch, capsys) -> None:
    """As of a command that is started with `<&-`: Python has None then."""
    monkeypatch.setattr(sys, "stdin", None)
    OperatorAtTerminal(Terminal()).ask_for_rest(2.0)
    assert capsys.readouterr().out == "taring for 2 s: it has to stand still ...\n"
