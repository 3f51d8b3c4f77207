"""A run of half a second, in which everything occurs that a run may have."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Flag, Reconstruction, Status, open_trial, stream
from tensegraph.models.structure.shape import OtherShape, Reason


@pytest.fixture(scope="session")
def short_run(example) -> Reconstruction:
    """The first half second of the example, live; frame 3 has another shape, tendon 5 of frame 2 is stuck and bent."""
    trial = open_trial(example)
    readings = (row for row in trial.readings() if row.host_s < 0.5)
    result = Reconstruction.of(trial.description.structure, stream(readings, trial.description))
    flags, mode = result.flags.copy(), result.mode.copy()
    flags[2, 5], mode[2, 5] = Flag.STUCK | Flag.MISSING, 1
    length_m, sigma_m = result.length_m.copy(), result.sigma_m.copy()
    length_m[2, 5], sigma_m[2, 5] = np.nan, np.inf
    other = OtherShape(np.round(result.node_position_m[3] + 0.01, 6), 1.25)
    return replace(
        result,
        flags=flags,
        mode=mode,
        length_m=length_m,
        sigma_m=sigma_m,
        status=(*result.status[:3], Status.TWO_SHAPES, *result.status[4:]),
        others=(None, None, None, other, *(None,) * (len(result) - 4)),
        doubts=(*(None,) * (len(result) - 1), Reason.LOADS),
    )
