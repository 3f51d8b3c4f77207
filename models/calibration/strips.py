"""Runs of an estimator on strips, processed like tendons: tared while their strain is known, and then estimated."""

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
    """The estimate on one recording, at the samples that are scored, see `Recording.counted`."""

    name: str
    speed_per_s: float
    """Speed of the recording in strain per second; nan for irregular motion."""
    t_s: NDArray[np.float64]
    """(samples,)"""
    strain: NDArray[np.float64]
    """(samples,) strain as measured by the rig."""
    rate_per_s: NDArray[np.float64]
    """(samples,) rate of the measured strain."""
    estimate: NDArray[np.float64]
    """(samples,) estimated strain."""
    sigma: NDArray[np.float64]
    """(samples,) standard deviation of the estimate, including that due to taring."""
    unscaled_sigma: NDArray[np.float64]
    """(samples,) sigma of the network before it is scaled."""
    spread: NDArray[np.float64]
    """(samples,) recent spread of strain, see `StrainSpread`."""
    beyond: NDArray[np.bool_]
    """(samples,) whether a sample is outside the range of the training."""

    @property
    def error(self) -> NDArray[np.float64]:
        """(samples,) estimated minus measured strain."""
        return self.estimate - self.strain


def run_strips(
    estimator: StrainEstimator,
    recordings: Sequence[Recording],
    gauge: StaticGauge,
    known: Mapping[str, StripGain],
    unified: bool = False,
) -> list[StripRun]:
    """Return the output of an estimator on recordings.

    A strip whose recording was in the training keeps its gain and offset from there (`known`). Any other strip is tared
    on the first 10 s of its recording, in which its strain is known from the rig, as that of a tendon is known at the
    rest shape. These 10 s are not scored.

    Args:
        estimator: the network, or a baseline.
        recordings: of strips.
        gauge: the common curve, with the spread of gain and offset over strips.
        known: gain and offset by name of recording.
        unified: whether bent samples count, too.
    """
    if not recordings:
        return []
    untared = [r for r in recordings if r.name not in known]
    tares = dict(known) | tare_strips(estimator, untared, gauge, unified)
    change, step_s = side_by_side(recordings, [tares[r.name] for r in recordings])
    estimate = estimator.estimate(change, step_s)
    runs = []
    for k, r in enumerate(recordings):
        samples = len(r.t_s)
        counted = r.counted(unified)
        strain = estimate.strain[:samples, k]
        common = change[:samples, k]
        tare_sigma = tares[r.name].sigma(common, gauge.slope(np.maximum(strain, 0)))
        run = StripRun(
            name=r.name,
            speed_per_s=r.speed_per_s,
            t_s=r.t_s[counted],
            strain=r.strain[counted],
            rate_per_s=np.gradient(r.strain, r.t_s)[counted],
            estimate=strain[counted],
            sigma=np.hypot(estimate.sigma[:samples, k], tare_sigma)[counted],
            unscaled_sigma=estimate.unscaled_sigma[:samples, k][counted],
            spread=estimate.spread[:samples, k][counted],
            beyond=estimate.beyond[:samples, k][counted],
        )
        runs.append(run)
    return [run for run in runs if len(run.t_s)]
