"""The panel of a live session names what is wrong."""

from io import StringIO

from rich.console import Console

from tensegraph.live.activity import Activity
from tensegraph.live.panel import Panel
from tensegraph.models.values.link import LinkState


def test_recordings_of_which_nothing_is_used_are_named() -> None:
    unused = {"range 0": "no reading used: distances are 1000 times those expected: are all units m?"}
    panel = Panel("live", Activity.of(0, 0), list, LinkState, aid_warnings=lambda: unused)
    console = Console(width=200, record=True, file=StringIO())
    console.print(panel)
    assert "range 0: no reading used: distances are 1000 times" in console.export_text()
