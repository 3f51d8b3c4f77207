"""Strips on the test rig, followed as tendons on a structure are: tared while their strain is known, then estimated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..sensor.gauge import StaticGauge
from .recordings import Recording
from .strain_estimators import StrainEstimator
from .strip_gains import StripGain, side_by_side, tare_strips


@dataclass(frozen=True, slots=True, eq=False)
class StripRun:
    """One recording, estimated; only where it counts: stretched, settled, and never trained on."""

    name: str
    speed_per_s: float
    """Nan for irregular motion."""
    t_s: NDArray[np.float64]
    """(samples,)"""
    strain: NDArray[np.float64]
    """(samples,) as the rig measured it."""
    change: NDArray[np.float64]
    """(samples,) dR/R as read."""
    rate_per_s: NDArray[np.float64]
    """(samples,) of the rig's strain."""
    estimate: NDArray[np.float64]
    """(samples,)"""
    sigma: NDArray[np.float64]
    """(samples,) with what the tare leaves."""
    tare_sigma: NDArray[np.float64]
    """(samples,) that alone."""
    unscaled_sigma: NDArray[np.float64]
    """(samples,) of the network alone, before calibration."""
    spread: NDArray[np.float64]
    """(samples,) of strain lately."""
    beyond: NDArray[np.bool_]
    """(samples,) flagged as beyond training."""

    @property
    def error(self) -> NDArray[np.float64]:
        """(samples,) estimate minus strain."""
        return self.estimate - self.strain


def run_strips(
    estimator: StrainEstimator,
    recordings: Sequence[Recording],
    gauge: StaticGauge,
    known: Mapping[str, StripGain],
    signed: bool = False,
) -> list[StripRun]:
    """Return an estimator's output on recordings.

    A strip whose recording was trained on keeps the gain and offset found there (`known`); any other is tared on its
    first 10 s, in which the rig tells its strain, as the rest shape tells a tendon's. These do not score.

    Args:
        estimator: the network, or a baseline.
        recordings: of strips.
        gauge: the common curve, and how much strips differ from it.
        known: tares by name.
        signed: whether bent samples count, too.
    """
    if not recordings:
        return []
    fresh = [r for r in recordings if r.name not in known]
    tares = dict(known) | tare_strips(estimator, fresh, gauge, signed)
    change, step_s = side_by_side(recordings, [tares[r.name] for r in recordings])
    followed = estimator.follow(change, step_s)
    runs = []
    for k, r in enumerate(recordings):
        samples = len(r.t_s)
        counted = r.counted(signed)
        strain = followed.strain[:samples, k]
        common = change[:samples, k]
        tare_sigma = tares[r.name].sigma(common, gauge.slope(np.maximum(strain, 0)))
        run = StripRun(
            name=r.name,
            speed_per_s=r.speed_per_s,
            t_s=r.t_s[counted],
            strain=r.strain[counted],
            change=r.change[counted],
            rate_per_s=np.gradient(r.strain, r.t_s)[counted],
            estimate=strain[counted],
            sigma=np.hypot(followed.sigma[:samples, k], tare_sigma)[counted],
            tare_sigma=tare_sigma[counted],
            unscaled_sigma=followed.unscaled_sigma[:samples, k][counted],
            spread=followed.spread[:samples, k][counted],
            beyond=followed.beyond[:samples, k][counted],
        )
        runs.append(run)
    return [run for run in runs if len(run.t_s)]
