"""What the viewer shows first: the runs side by side in space, and over time what they say of themselves."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...models.structure.reconstruction import Reconstruction
from .run_log import TIMELINE, RunLog
from .scene import MAGNIFICATIONS, ellipsoids_name

WHITE = [255, 255, 255]


def first_screen(runs: Sequence[RunLog], tendon: int = 0, *, follow: bool = False) -> Any:
    """Return the layout of the screen; magnified ellipsoids are there, but hidden.

    Args:
        runs: the runs, all of structures with the same tendons.
        tendon: whose length is in front.
        follow: whether to stay at the newest frame, as in a live session.
    """
    import rerun.blueprint as rrb

    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Horizontal(*(_space(rrb, run) for run in runs)), _curves(rrb, runs, tendon), column_shares=[3, 2]
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following" if follow else "playing"),
        auto_views=False,
    )


def liveliest_tendon(result: Reconstruction) -> int:
    """Return the tendon whose length changes most in a run, whose panel is worth the first look."""
    return int(np.argmax(np.ptp(result.predicted_m, axis=0)))


def _space(rrb: Any, run: RunLog) -> Any:
    magnified = [f"{run.space}/{ellipsoids_name(scale)}" for scale in MAGNIFICATIONS[1:]]
    return rrb.Spatial3DView(
        origin=run.space,
        name=run.name or "shape",
        background=WHITE,
        overrides={entity: rrb.EntityBehavior(visible=False) for entity in magnified},
    )


def _curves(rrb: Any, runs: Sequence[RunLog], tendon: int) -> Any:
    """Return the status, a tab for the length of each tendon, and the quantities of all nodes and tendons."""
    roots = [run.root for run in runs]
    hidden = rrb.PlotLegend(visible=False)
    linked = rrb.TimeAxis(link="LinkToGlobal")  # all panels show the same time
    count = max(len(run.structure.tendons) for run in runs)
    lengths = [
        rrb.TimeSeriesView(name=f"tendon {e} [m]", contents=[f"{root}/length_m/{e}" for root in roots], axis_x=linked)
        for e in range(count)
    ]
    return rrb.Vertical(
        rrb.StateTimelineView(name="status", contents=[f"{root}/status" for root in roots], time_view=linked),
        rrb.Tabs(*lengths, active_tab=tendon, name="lengths"),
        *(
            rrb.TimeSeriesView(
                name=name, contents=[f"{root}/{entity}" for root in roots], plot_legend=hidden, axis_x=linked
            )
            for name, entity in (("sigma of the nodes [m]", "sigma_m"), ("innovations [sigma]", "innovation"))
        ),
        row_shares=[2, 4, 3, 3],
    )
