"""The settings of the estimators: noise of each kind of factor, smoother, sensor health, search for another shape."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Interval

from .values.tables import SMALLEST_SIGMA, Positive, PositiveOrInfinite, Probability, Sigma


@dataclass(frozen=True, slots=True)
class NoiseSettings:
    """Standard deviation of each kind of factor, per axis or per length."""

    rod_m: Sigma = 0.0002
    """Standard deviation of a rod's length."""
    anchor_m: Sigma = 0.0001
    """Standard deviation of an anchor's position, per axis."""
    stretching_m: Sigma = 0.0002
    """Standard deviation of the length of a stretched tendon as the distance between its nodes. The variance of the
    reading is added."""
    bending_m: Sigma = 0.001
    """Standard deviation of the length of a bent tendon as the distance between its nodes. The variance of the reading
    is added."""
    ambiguous_m: Sigma = 0.001
    """The same for a tendon whose mode is uncertain, so that it may be bent. The sigma of its reading covers the
    difference between the modes."""
    unstated_m: Sigma = 0.001
    """Standard deviation of a length that a trial gives without its sigma."""
    force_n: Sigma = 0.1
    """Standard deviation of the balance of forces at a node. Inertia and damping of moving rods stay below it."""
    shape_prior_m: Annotated[PositiveOrInfinite, Ge(SMALLEST_SIGMA)] = 0.06
    """Standard deviation of a node about its rest position, per axis and in every frame: a weak prior that keeps the
    variance finite along motions that lengths do not observe. A press moves a node by 7 mm rms; for slack structures,
    which move by 30 mm rms, 0.03 is better."""
    motion_m_per_s15: Sigma = 0.3
    """Square root of the power density of the acceleration: that of a hand which changes its push by 0.7 m/s^2 every
    0.2 s."""
    correlation_s: Positive = 2.6
    """Time for which the errors of the lengths last: the correlation time of the network's errors in calibration."""
    robust: Literal["none", "huber", "cauchy"] = "none"
    """Robust kernel on the tendon lengths, with the constant that gives 95 % efficiency on Gaussian noise. With one,
    the errors of lengths count as independent, and what sensors share is not used."""


@dataclass(frozen=True, slots=True)
class SmootherSettings:
    """The window of the live smoother, and when it linearises again."""

    lag: Annotated[int, Interval(ge=2, le=10)] = 2
    """Number of frames in the window; older frames are marginalised into a prior. The motion prior needs at least
    two. More give hardly another estimate (five: the RMSE of six trials changes by less than 1 %), and gtsam's ordering
    allows no more places than an update has nodes, so that small structures have fewer."""
    relinearize_m: Positive = 0.003
    """Distance by which a node moves before its factors are linearised again. Over 3 mm the linearised length is wrong
    by 0.03 mm, far less than its sigma."""


@dataclass(frozen=True, slots=True)
class HealthSettings:
    """When a sensor is left out because it disagrees with the others, and when it is used again."""

    memory_s: Positive = 0.5
    """Time constant of the mean of a sensor's studentised residual. A press is shorter, a fault is longer."""
    suspect_sigma: Positive = 2.5
    """Mean studentised residual above which a sensor is checked."""
    check_every_s: Positive = 0.1
    """Shortest time between two checks. A check takes as long as the estimate of a frame."""
    expected_log_ratio: Positive = 3.0
    """Log likelihood ratio of a frame without and with a sensor, as expected of a healthy sensor whose error is large
    by chance. It is subtracted from the log ratio of each check."""
    log_ratio: Positive = 9.0
    """Cumulative sum of the checks at which the sensor is left out: high enough for 24 sensors, checked 10 times a
    second, for hours."""
    agree_sigma: Positive = 2.0
    """Mean studentised residual below which a sensor that is left out agrees with the others again."""
    take_back_s: Positive = 1.0
    """Time for which a sensor that is left out must agree before it is used again."""
    alike_share: Probability = 0.33
    """Share of the sensors that are suspect or left out above which no further one is left out: something that all
    have in common moves them."""


@dataclass(frozen=True, slots=True)
class DoubtSettings:
    """What loads are expected, and when the readings contradict the model."""

    loaded_share: Probability = 0.1
    """Prior probability that a node is loaded, when a few nodes are."""
    load_n: Sigma = 1.5
    """Standard deviation of the load at a loaded node: that of a finger."""
    quiet_n: Sigma = 0.03
    """Standard deviation of the balance at a node without load, in the comparison of explanations: what the rest step
    leaves, and slow motion."""
    many_share: Probability = 0.1
    """Prior probability that many nodes are loaded at once."""
    many_loads_n: Sigma = 1.0
    """Standard deviation of the load at each node, when many nodes are loaded. Lengths say little of loads that move
    the structure along its mechanism."""
    shaken_n: Sigma = 5.0
    """The same while the robot is shaken: the force that shakes it, and the inertia of the rods."""
    many_memory_s: Positive = 20.0
    """Time for which many nodes stay loaded, or a few."""
    inexact_share: Probability = 0.04
    """Prior probability that all lengths are less exact than their sigmas say."""
    inexact_memory_s: Positive = 2.0
    """Time for which they stay so."""
    update_every_s: Positive = 0.1
    """Shortest time between two comparisons, each of which takes a sixth of the time of a frame."""


@dataclass(frozen=True, slots=True)
class BranchSettings:
    """When the other shape that explains the same lengths is searched for and reported."""

    look_every_s: Positive = 0.5
    """Shortest time between the starts of two searches. A search does one iteration in each frame, ten or so in all,
    and its result is reported until that of the next. The method `frame` searches by itself in each frame that the
    shape hardly explains."""
    log_ratio: Positive = 3.0
    """Log likelihood ratio of the estimated shape to the other one below which the other is reported; 3 means a ratio
    of 20."""
