"""A structure whose rest can be worked by hand."""

import numpy as np
import pytest

from tensegraph import Structure


@pytest.fixture(scope="session")
def hanging() -> Structure:
    """A rod (3 over 4) that hangs from three anchors by three tendons; another three, long and loose, hold its foot."""
    angle = np.deg2rad([90.0, 210.0, 330.0])
    anchors = np.stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), 0 * angle], axis=1)
    tendons = np.array([[0, 3], [1, 3], [2, 3], [0, 4], [1, 4], [2, 4]])
    natural_m = np.repeat([0.21, 0.9], 3)
    return Structure(
        rods=np.array([[3, 4]]),
        tendons=tendons,
        rod_length_m=np.array(0.3),
        natural_length_m=natural_m,
        anchors=np.arange(3),
        anchor_position_m=anchors,
    )
