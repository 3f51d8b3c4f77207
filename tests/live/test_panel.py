"""The panel of a live session names what is wrong."""

import re
from io import StringIO

from rich.console import Console

from tensegraph.live.activity import Activity
from tensegraph.live.panel import Panel
from tensegraph.models.values.link import LinkState
from tensegraph.models.values.readings import Flag


def test_recordings_of_which_nothing_is_used_are_named() -> None:
    unused = {"range 0": "no reading used: distances are 1000 times those expected: are all units m?"}
    panel = Panel("live", Activity.of(0, 0), list, LinkState, warnings=lambda: unused)
    console = Console(width=200, record=True, file=StringIO())
    console.print(panel)
    assert "range 0: no reading used: distances are 1000 times" in console.export_text()


def test_a_tendon_without_a_sensor_is_not_flagged(loaded) -> None:
    loaded.flags[0, [5, 7, 11]] = int(Flag.MISSING)
    activity = Activity.of(0, 0)
    activity.shape = loaded[0.0]
    panel = Panel("live", activity, list, LinkState, unsensed=[5, 11])
    console = Console(width=200, record=True, file=StringIO())
    console.print(panel)
    assert re.search(r"flagged +│ 7: missing", console.export_text())
