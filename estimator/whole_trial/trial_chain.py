"""The frames of a trial, chained by the motion prior, and the shapes of least error.

The motion prior couples each coordinate with itself in the two frames before, so that the information of all frames is
banded: blocks of the frames' own factors, and two diagonals. With D the rows of `motion_rows`, one Gauss-Newton step of
all frames is

    (diag(H_t) + D^T D + damping I) delta = -(g + D^T D (x - x_rest))

solved by a banded Cholesky factorisation in windows of frames, in each of which the frames outside stand still. The
windows overlap by `OVERLAP` frames, of which the outer ones are dropped: over these the shape prior forgets what the
frames outside do. The steps end where the gradient of all frames is zero, so that windows do not change the result.
"""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded

from ...models.values.time_series import parts
from .parts import STACKED, WINDOW
from .trial_factors import TrialFactors

Progress = Callable[[int, float], None]
"""Function that is called after each iteration of an optimisation, with its number from 1 and the error."""
OVERLAP = 250
"""Number of frames that windows overlap on each side. At 50 frames a second a motion that only the shape prior and the
motion prior know of is forgotten over them to 1e-9; one that lengths see, much sooner."""
MAX_BATCH_ITERATIONS = 50
"""Number of iterations after which the optimisation has not converged."""
RELATIVE_DECREASE = 1e-3
"""Decrease of the error in one iteration, as a share of it, below which the optimisation has converged."""
MIN_DAMPING = 1e2
"""Least damping above zero, in 1 / m^2: a prior of 0.1 m about the last values."""
MAX_DAMPING = 1e10
"""Largest damping, in 1 / m^2: a prior of 0.01 mm about the last values."""


class TrialChain:
    """The factors of all frames of a trial, those between frames included."""

    def __init__(
        self,
        factors: TrialFactors,
        motion_rows: NDArray[np.float64],
        free_coordinates: NDArray[np.int64],
        rest_position_m: NDArray[np.float64],
    ) -> None:
        """Chain frames.

        Args:
            factors: of each frame alone.
            motion_rows: (frames, 3) the motion prior, see `motion_rows`.
            free_coordinates: (free,) the coordinates to which it applies.
            rest_position_m: (nodes, 3) the rest shape, about which the first frame is.
        """
        self._factors = factors
        self._rows = np.concatenate([motion_rows, np.zeros((2, 3))])  # what two further frames would add
        self._free = free_coordinates
        self._rest_m = rest_position_m.ravel()

    def error(self, node_position_m: NDArray[np.float64]) -> float:
        """Return the error of all factors at (frames, nodes, 3) shapes, half a sum of squares without kernels."""
        own = [self._factors.error(node_position_m[part], part).sum() for part in parts(len(node_position_m), STACKED)]
        return float(sum(own) + 0.5 * np.sum(self._motion_error(node_position_m) ** 2))

    def step(self, node_position_m: NDArray[np.float64], damping: float) -> NDArray[np.float64]:
        """Return the (frames, nodes, 3) Gauss-Newton step from some shapes.

        Args:
            node_position_m: (frames, nodes, 3) the shapes.
            damping: in 1 / m^2, added to the information of every coordinate.

        Raises:
            LinAlgError: when the factors leave some motion undetermined.
        """
        x = node_position_m.reshape(len(node_position_m), -1)
        gradient_of_motion = self._motion_gradient(self._motion_error(node_position_m))
        step = np.empty_like(x)
        for kept, window in _windows(len(x)):
            band, gradient = self._linear(node_position_m, window)
            band[:, :, 0] += damping
            gradient[:, self._free] += gradient_of_motion[window]
            lower = band.reshape(-1, band.shape[-1]).T
            root = cholesky_banded(lower, overwrite_ab=True, lower=True, check_finite=False)
            solved = cho_solve_banded((root, True), -gradient.ravel(), overwrite_b=True, check_finite=False)
            first = kept.start - window.start
            step[kept] = solved.reshape(gradient.shape)[first : first + kept.stop - kept.start]
        return step.reshape(node_position_m.shape)

    def _linear(
        self, node_position_m: NDArray[np.float64], window: slice
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the information of a window and (frames, size) the gradient of the frames' own factors.

        The information is (frames, size, 2 size + 1), its lower band: in [t, i, k] stands the row that is k below the
        diagonal in the column of coordinate i of frame t.
        """
        count, size = window.stop - window.start, self._rest_m.size
        band = np.zeros((count, size, 2 * size + 1))
        gradient = np.empty((count, size))
        row, column = np.tril_indices(size)
        for part in parts(count, STACKED):
            frames = slice(window.start + part.start, window.start + part.stop)
            information, gradient[part] = self._factors.linear(node_position_m[frames], frames)
            band[part, column, row - column] = information[:, row, column]
        oldest, before, now = self._rows[window.start : window.stop + 2].T
        band[:, self._free, 0] += (now[:-2] ** 2 + before[1:-1] ** 2 + oldest[2:] ** 2)[:, None]
        band[:, self._free, size] = (now[1:-1] * before[1:-1] + before[2:] * oldest[2:])[:, None]
        band[:, self._free, 2 * size] = (now[2:] * oldest[2:])[:, None]
        return band, gradient

    def _motion_error(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (frames, free) the residuals of the motion prior over their sigma, D (x - x_rest)."""
        moved = (node_position_m.reshape(len(node_position_m), -1) - self._rest_m)[:, self._free]
        oldest, before, now = self._rows[:-2].T[:, :, None]
        error = now * moved
        error[1:] += before[1:] * moved[:-1]
        error[2:] += oldest[2:] * moved[:-2]
        return np.asarray(error)

    def _motion_gradient(self, error: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (frames, free) D^T of the residuals."""
        oldest, before, now = self._rows[:-2].T[:, :, None]
        gradient = now * error
        gradient[:-1] += before[1:] * error[1:]
        gradient[:-2] += oldest[2:] * error[2:]
        return np.asarray(gradient)


def _windows(count: int) -> Iterator[tuple[slice, slice]]:
    """Yield slices of frames that follow each other, each with the window in which they are solved."""
    for kept in parts(count, WINDOW):
        yield kept, slice(max(kept.start - OVERLAP, 0), min(kept.stop + OVERLAP, count))


def no_progress(iteration: int, error: float) -> None:
    """Tell nobody."""


def minimised(
    chain: TrialChain,
    node_position_m: NDArray[np.float64],
    progress: Progress = no_progress,
    steps: int = MAX_BATCH_ITERATIONS,
) -> tuple[NDArray[np.float64], bool]:
    """Return the (frames, nodes, 3) shapes of least error, and whether the search converged, by Levenberg-Marquardt.

    It ends when the error falls by less than one part in a thousand. Along the mechanism the error is so flat that a
    smaller bound would cost a hundred further iterations for one part in 1e5 of the error, which is a tenth of one
    standard deviation of one length.

    Args:
        chain: the factors.
        node_position_m: (frames, nodes, 3) shapes at which the search starts.
        progress: called after each iteration with its number and the error.
        steps: largest number of iterations.

    Raises:
        LinAlgError: when the factors leave some motion undetermined.
    """
    error = chain.error(node_position_m)
    damping = 0.0
    for iteration in range(steps):
        before = error
        while damping <= MAX_DAMPING:
            candidate_m = node_position_m + chain.step(node_position_m, damping)
            error = chain.error(candidate_m)
            if error <= before:
                break
            damping = max(10 * damping, MIN_DAMPING)
        else:
            return node_position_m, False
        node_position_m = candidate_m
        damping = damping / 10 if damping > MIN_DAMPING else 0.0
        progress(iteration + 1, error)
        if before - error <= RELATIVE_DECREASE * before:
            return node_position_m, True
    return node_position_m, False
