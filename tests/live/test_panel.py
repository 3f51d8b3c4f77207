"""The panel of a live session names what is wrong."""

import re
from dataclasses import replace
from io import StringIO

import numpy as np
from rich.console import Console

from tensegraph import Settings, open_trial
from tensegraph.live.activity import Activity
from tensegraph.live.panel import Panel
from tensegraph.models.values.link import LinkState
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
    assert "geometry: the anchors are elsewhere than trial.toml tells" in shown(Activity.of(0, 0), pipeline)


def test_a_tendon_without_a_sensor_is_not_flagged(example, model, loaded) -> None:
    loaded.flags[0, [5, 7, 11]] = int(Flag.MISSING)
    activity = Activity.of(0, 0)
    activity.shape = loaded[0.0]
    description = open_trial(example).description
    unsensed = replace(description, structure=replace(description.structure, unsensed=np.array([5, 11])))
    assert re.search(r"flagged +│ 7: missing", shown(activity, Pipeline(unsensed, Settings(), model)))
