"""How the estimator weighs what it is given: noise of each kind of factor, the smoother's bounds, health, branches."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge

from .values.tables import Positive, Probability


@dataclass(frozen=True, slots=True)
class NoiseSettings:
    """How far each kind of factor may be from true, per axis or per length, one sigma."""

    rod_m: Positive = 0.0002
    """Of a rod's length."""
    anchor_m: Positive = 0.0001
    """Of an anchor's position."""
    stretching_m: Positive = 0.0002
    """Of a stretched tendon as a straight line between its nodes; the reading's own sigma comes on top."""
    bending_m: Positive = 0.001
    """Of a bent one."""
    ambiguous_m: Positive = 0.001
    """Of one whose mode is not sure: it may be bent. That the reading spans both modes is in the reading's sigma."""
    unstated_m: Positive = 0.001
    """Of a length that a trial gives without its sigma."""
    force_n: Positive = 0.1
    """Of the balance of forces at a node: inertia and damping of moving rods stay below."""
    shape_prior_m: Positive = 0.06
    """Of a node about its rest position, in every frame: weak, but it keeps the motion that lengths do not see finite.
    Three times what presses move a node (7 mm rms); slack bodies, which move by 30 mm rms, want 0.03."""
    motion_m_per_s15: Positive = 0.3
    """Square root of the acceleration's power density: a hand that changes its push by 0.7 m/s^2 every 0.2 s."""
    robust: Literal["none", "huber", "cauchy"] = "none"
    """Kernel on the tendon lengths, at its usual 95 % efficiency."""


@dataclass(frozen=True, slots=True)
class SmootherSettings:
    """How the live smoother is bounded."""

    lag: Annotated[int, Ge(2)] = 5
    """Frames kept, at least two, which motion spans; older ones are marginalised into a prior."""
    relinearize_m: Positive = 0.003
    """A node that moves this far is linearised anew: a length bends away by 0.03 mm in 3 mm, far below its sigma."""


@dataclass(frozen=True, slots=True)
class HealthSettings:
    """When a sensor is left out because the others do not bear it out, and when it is taken back."""

    memory_s: Positive = 0.5
    """Over which disagreement is averaged: a press comes and goes in less, a fault does not."""
    suspect_sigma: Positive = 2.5
    """Mean disagreement from which on a sensor is checked."""
    check_every_s: Positive = 0.1
    """Least time between two checks, which take as long as a frame each."""
    expected_log_ratio: Positive = 3.0
    """Log of how many times better a frame is explained without a sensor that is merely unlucky, ..."""
    log_ratio: Positive = 9.0
    """... and how far the checks must add up to more: 24 sensors, checked 10 times a second, for hours."""
    agree_sigma: Positive = 2.0
    """Mean disagreement below which a sensor that was left out agrees again, ..."""
    take_back_s: Positive = 1.0
    """... and for how long it must before it is taken back."""
    alike_share: Probability = 0.33
    """When more sensors than this share stand out or are left out, they drift: no further one is accused."""


@dataclass(frozen=True, slots=True)
class BranchSettings:
    """When the other shape with these lengths is told of."""

    look_every_s: Positive = 0.5
    """Least time between two looks, which take as long as two frames each; in between the last one holds."""
    log_ratio: Positive = 3.0
    """Log of how many times better the shape must explain its frame (20 times) for the other not to be told of."""
