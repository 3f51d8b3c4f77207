"""The settings of the pose filter: how a free-standing structure moves, and how exact its aids are."""

from dataclasses import dataclass

from ..values.tables import AngularRate, NotNegative, Positive


@dataclass(frozen=True, slots=True)
class PoseSettings:
    """Motion of the body, footholds, and the errors of inertial sensors, ranges and positions."""

    turn_rad_per_s: AngularRate = 1.5
    """Standard deviation of the angular rate: a robot that tips over an edge."""
    motion_m_per_s: Positive = 0.3
    """Standard deviation of the velocity of the centroid, for the same motion."""
    motion_holds_s: Positive = 0.15
    """Time for which rate and velocity last."""
    floor_m: Positive = 0.0005
    """Standard deviation of the height of the floor where a node stands."""
    shape_holds_s: Positive = 0.2
    """Time for which the errors of the shape last: over this time the readings of floor and footholds count once."""
    shape_lag_s: NotNegative = 0.0035
    """Error of each node's place in the shape, per axis, in proportion to the change of the body's velocity by blows
    and pushes: strips follow late. Shapes of roll_01 and of four simulated trials were wrong by 0.0031 to 0.0040 s."""
    lifted_m: Positive = 0.1
    """Mean height of a node that does not stand."""
    steps_per_s: Positive = 2.0
    """Rate at which nodes are lifted from the floor or put on it."""
    creep_m_per_s05: Positive = 0.0003
    """Random walk of a foothold: rubber that creeps on the floor."""
    slip_m_per_rad05: Positive = 0.007
    """Random walk of a foothold with the angle that the body turns: nodes slip a little while the robot tips."""
    slide_m_per_m05: Positive = 0.1
    """Random walk of a foothold with the way that its node slides, at a mean share of the weight, where a structure
    deforms whose attitude nothing measures."""
    slip_sigma: Positive = 4.0
    """Distance from its foothold, in standard deviations, at which a node has slipped."""
    rate_rad_per_s: Positive = 0.001
    """White noise of an inertial sensor's rate, per sample."""
    rate_scale: NotNegative = 0.01
    """Error of the rate in proportion to it, about each axis of a sensor, which lasts."""
    rate_bias_rad_per_s: Positive = 0.01
    """Bias of the rate at the start."""
    rate_bias_rad_per_s15: Positive = 1e-4
    """Random walk of this bias."""
    deformation_rad_per_s: AngularRate = 0.1
    """Rate at which a rod turns against the body, because the structure deforms."""
    spin_rad_per_s: AngularRate = 0.2
    """Rate at which a rod spins about itself against the body, in which tendons hold it loosely."""
    force_m_per_s2: Positive = 0.1
    """Noise of the specific force over a frame, in slow motion."""
    force_share: Positive = 0.1
    """Further noise of the specific force, in proportion to its difference from gravity: shocks and vibration."""
    force_bias_m_per_s2: Positive = 0.15
    """Bias of the specific force at the start."""
    force_bias_m_per_s25: Positive = 1e-3
    """Random walk of this bias."""
    misalignment_rad: Positive = 0.017
    """Angle between a rod and its direction in the sensor's axes as told."""
    range_m: Positive = 0.05
    """White noise of a range."""
    range_offset_m: Positive = 0.07
    """Offset of a range, the same for each pair of beacon and node."""
    beacon_error_m: NotNegative = 0.1
    """Error of all ranges of a beacon, which lasts, as of somebody who stands before it, or a wall beside the way: as
    large as what `RangeTrust` does not find out."""
    hang_rad: Positive = 0.2
    """Standard deviation of the direction in which a structure hangs, when no hand is seen. One that begins to push
    is seen 0.3 s later, when it has tilted the structure by 10 to 15 degrees."""
    swing_s: Positive = 1.0
    """Time in which a swing of a structure that hangs dies out, to a third."""
    position_m: Positive = 0.0005
    """Standard deviation of a position, per axis."""
