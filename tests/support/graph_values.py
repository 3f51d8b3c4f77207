"""Positions of nodes as gtsam's values."""

import gtsam

from tensegraph.factors.keys import frame_keys
from tensegraph.models.estimation import NoiseSettings

NOISE = NoiseSettings()


KEYS = (frame_keys(0, 12), frame_keys(1, 12), frame_keys(2, 12))


def values_of(positions) -> gtsam.Values:
    """Values of (frames, 12, 3) positions."""
    values = gtsam.Values()
    for frame, position in enumerate(positions):
        for node, x in enumerate(position):
            values.insertPoint3(frame_keys(frame, 12)[node], x)
    return values
