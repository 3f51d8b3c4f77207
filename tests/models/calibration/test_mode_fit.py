"""The odds of bending, from histograms of recordings."""

import numpy as np

from tensegraph.models.calibration.mode_fit import fit_mode
from tensegraph.models.calibration.recordings import Recording


def test_readings_beyond_those_that_were_seen_have_the_odds_of_the_farthest() -> None:
    """Bent down to dR/R = -0.1 and stretched up to 0.2: bins without a reading had even odds."""
    t_s = np.arange(0, 120, 0.05)
    bent, stretched = -0.05 + 0.05 * np.cos(0.1 * t_s), 0.1 - 0.1 * np.cos(0.1 * t_s)
    odds = fit_mode([Recording("bent", t_s, bent, bent), Recording("stretched", t_s, stretched, stretched)])
    assert (odds.at(np.array([-0.1, -0.15, -0.25, -1.0])) > 5).all()
    assert (odds.at(np.array([0.19, 0.25, 1.0])) < -5).all()
