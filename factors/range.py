"""Ranges: the distance between a beacon and a node, with an offset o that each pair keeps.

    y = |x - b| + o + e + noise

and an error e that all ranges of a beacon have as long as somebody stands before it, which is considered. The variance
of a range is that of the noise and u^T P u, with u = (x - b) / |x - b| and the covariance P of the node in the shape.

A range that a wall has reflected is too long. Its weight is that of Huber's kernel, and beyond `OUTLIER` it has none.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..models.pose.placed import PlacedShape, Rows
from ..models.values.aids import RangeReading

HUBER = 1.345
"""Studentised error from which a range loses weight, which keeps 95 % efficiency on Gaussian noise."""
OUTLIER = 5.0
"""Studentised error from which a range is left out."""
NEAREST_M = 1e-6
"""Distance below which a beacon is at its node, and the range tells nothing of a direction."""


def range_error(
    placed: PlacedShape, reading: RangeReading, numbers: tuple[int, int]
) -> tuple[float, NDArray[np.float64], float]:
    """Return the range minus that predicted, with the latter's derivative and variance.

    The derivative is (size,), by the errors of the state; the variance is that of the shape.
    """
    difference = placed.node_position_m[reading.node] - reading.beacon_position_m
    distance = float(np.linalg.norm(difference))
    u = difference / max(distance, NEAREST_M)
    jacobian = u @ placed.jacobian[reading.node]
    state, (pair, beacon) = placed.state, numbers
    jacobian[state.layout.range_offset.start + pair] = jacobian[state.layout.beacon_error.start + beacon] = 1.0
    error_m = reading.range_m - distance - float(state.range_offset_m[pair] + state.beacon_error_m[beacon])
    return error_m, jacobian, float(u @ placed.node_covariance_m2[reading.node] @ u)


def range_rows(
    placed: PlacedShape,
    readings: Sequence[RangeReading],
    numbers_of_pair: Mapping[tuple[int, int, int], tuple[int, int]],
    covariance: NDArray[np.float64],
    sigma_m: float,
) -> tuple[Rows, list[RangeReading]]:
    """Return one row for each range that is no outlier, and the ranges that are outliers.

    Args:
        placed: the shape in the world.
        readings: the ranges of one frame.
        numbers_of_pair: the numbers of each pair, and of its beacon, in the state.
        covariance: (size, size) of the errors of the state.
        sigma_m: standard deviation of a range.
    """
    size = placed.state.layout.size
    rows, outliers = [], []
    for reading in readings:
        error, jacobian, of_shape = range_error(placed, reading, numbers_of_pair[reading.pair])
        variance = sigma_m**2 + of_shape
        studentised = abs(error) / float(np.sqrt(jacobian @ covariance @ jacobian + variance))
        if studentised < OUTLIER:
            rows.append((error, jacobian, variance * max(studentised / HUBER, 1.0)))
        else:
            outliers.append(reading)
    kept = Rows(
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]).reshape(-1, size),
        np.array([row[2] for row in rows]),
    )
    return kept, outliers
