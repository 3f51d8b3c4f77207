"""Poses of free-standing structures for tests."""

import numpy as np

from tensegraph.models.pose.pose_state import PoseState
from tensegraph.models.values.rotations import rotation


def any_state(imus: int, pairs: int, seed: int = 4, tilts: int = 0, own_frames: int = 0) -> PoseState:
    """Return a state in which every part differs from zero, of a structure with 12 nodes."""
    rng = np.random.default_rng(seed)
    return PoseState(
        turn=rotation(np.array([0.3, -0.5, 0.7])),
        position_m=np.array([0.1, -0.2, 0.3]),
        rate_rad_per_s=rng.standard_normal(3),
        velocity_m_per_s=0.1 * rng.standard_normal(3),
        foothold_m=0.1 * rng.standard_normal((12, 2)),
        imu_turn=rotation(rng.standard_normal((imus, 3))),
        rate_bias_rad_per_s=0.01 * rng.standard_normal((imus, 3)),
        force_bias_m_per_s2=0.1 * rng.standard_normal((imus, 3)),
        misalignment=0.02 * rng.standard_normal((imus, 2)),
        range_offset_m=0.05 * rng.standard_normal(pairs),
        floor_tilt=0.1 * rng.standard_normal(tilts),
        own_frame_error=rng.standard_normal((own_frames, 6)),
    )
