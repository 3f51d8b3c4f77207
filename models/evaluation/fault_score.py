"""Scores of the detection of faulty sensors, and of false alarms for healthy ones."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ..structure.reconstruction import Reconstruction
from ..values.readings import SENSOR_FLAGS, Flag
from .evaluation import FaultScore
from .truth import Fault


def named_as_fault(estimate: Reconstruction) -> NDArray[np.bool_]:
    """Return (frames, tendons) where a flag describes a fault of a sensor, or its length was left out."""
    named = ((estimate.flags & int(SENSOR_FLAGS)) != 0) | ~np.isfinite(estimate.sigma_m)
    return np.asarray(named & estimate.structure.is_sensed)


def score_fault(fault: Fault, estimate: Reconstruction) -> FaultScore:
    """Return whether and when a fault was detected."""
    during = fault.during(estimate.t_s)
    named = named_as_fault(estimate)[during][:, fault.tendons]
    detected = np.asarray(named.any(axis=0))
    delay_s = None
    if len(detected) and detected.all():
        begun_s = max(fault.from_s, float(estimate.t_s[0]))
        delay_s = float((estimate.t_s[during][named.argmax(axis=0)] - begun_s).max())
    return FaultScore(
        kind=fault.kind,
        where=fault.where,
        from_s=fault.from_s,
        tendons=len(detected),
        named=int(detected.sum()),
        delay_s=delay_s,
    )


def false_alarm_share(faults: Iterable[Fault], estimate: Reconstruction) -> float:
    """Return the share of the readings without a fault that are flagged as faulty or left out."""
    healthy = np.broadcast_to(estimate.structure.is_sensed, estimate.flags.shape).copy()
    for fault in faults:
        healthy[np.ix_(fault.during(estimate.t_s), fault.tendons)] = False
    healthy &= (estimate.flags & int(SENSOR_FLAGS)) != int(Flag.MISSING)  # there is no reading
    return float(np.mean(named_as_fault(estimate)[healthy])) if healthy.any() else np.nan
