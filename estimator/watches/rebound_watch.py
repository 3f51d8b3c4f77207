"""Whether the strips remember their past more than those of the calibration did.

The front end corrects what a strip remembers by as much as in calibration. What is left of a larger memory looks like
loads: while a press is held it seems to fade, and when it ends the same nodes seem to be pulled the other way for a
second, although no hand does that after every press. With the loads f of all nodes, F at the height of a press, the
ratio of its rebound is

    rho = max -f(t) . F / |F|^2     in `REBOUND_S` after f . F has fallen below 0.2 |F|^2

In presses and squeezes that the twin simulates it is 0.14 +- 0.1 with strips like those of the calibration, and 0.3 to
0.6 with creep, or creep and loops, three times as large; a share of the presses has any other. Each press multiplies
the odds of a larger memory by the ratio of both probabilities. All presses since the start count, as strips do not
change: the doubt stays until it is less probable than at the start. A ratio above 1 is that of a hand which pulls, and
all begins anew unless the strips are found out.

The shape is not corrected, as the memory of each strip is not known. Its errors are about rho m, with the mean m of the
deformation u over the last second, and while it changes rho (u - m): the covariance grows by

    rho^2 (m m^T + (u - m) (u - m)^T)
"""

import numpy as np
from numpy.typing import NDArray

from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import Reason, Shape
from ...models.values.readings import TendonLengths
from ...models.values.time_series import low_pass_weight

LEAST_PRESS = 0.7
"""Load of a press over the standard deviation of that of a finger, above which its rebound is looked at."""
ENDED = 0.2
"""Share of its height below which a press has ended."""
REBOUND_S = 1.5
"""Time after the end of a press in which a rebound shows."""
PRIOR_LOG_ODDS = float(np.log(0.003 / 0.997))
"""That the strips remember more than those of the calibration."""
CALIBRATED = (0.1, 0.1, 0.08)
"""Mean and standard deviation of the ratio with strips like those of the calibration, and share of presses with any."""
REMEMBERING = (0.4, 0.13, 0.15)
"""The same of strips that remember more."""
DEFORMATION_MEMORY_S = 1.0
"""Time constant of the mean deformation: what is left of a press after its end fades so fast."""


class ReboundWatch:
    """Follows the loads of one frame after another.

    Args:
        rest: the rest shape.
        finger_n: standard deviation of the load of a finger.
    """

    def __init__(self, rest: RestShape, finger_n: float) -> None:
        self._rest = rest
        self._least_n = LEAST_PRESS * finger_n
        self.ratio = 0.0
        """Of the rebound; 0 while nothing is found out."""
        self._begin()
        self._anew()
        self._learned_s = np.nan
        self._mean_m = np.zeros(len(rest.structure.free_coordinates))
        self._last_s = np.nan

    def observe(self, shape: Shape) -> Shape:
        """Return the shape of one more frame, with doubt and a wider covariance if the strips remember more."""
        if shape.loads is not None:
            self.learn(shape.lengths, shape.loads.force_n, in_motion=shape.doubt is Reason.MOTION)
        return self.widened(shape)

    def learn(self, lengths: TendonLengths, force_n: NDArray[np.float64], *, in_motion: bool) -> None:
        """Learn from the loads in one more frame.

        Args:
            lengths: of the frame.
            force_n: (nodes, 3) the loads; nan at anchors.
            in_motion: whether the robot is shaken, so that they are inertia.
        """
        if not lengths.of_strips:
            return
        structure = self._rest.structure
        measured = np.isfinite(lengths.sigma_m[structure.sensed_tendons])
        gap_s = lengths.t_s - self._learned_s
        self._learned_s = lengths.t_s
        if gap_s > REBOUND_S / 2 or 2 * np.count_nonzero(measured) < len(measured):
            self._begin()  # nothing tells how a press ended
        elif not in_motion:
            self._follow(lengths.t_s, np.nan_to_num(force_n[structure.free_nodes]).ravel())

    def widened(self, shape: Shape) -> Shape:
        """Return a shape with doubt and a wider covariance if the strips remember more; shapes in order of time."""
        free = self._rest.structure.free_coordinates
        deformation_m = (shape.node_position_m - self._rest.node_position_m).reshape(-1)[free]
        step_s = shape.t_s - self._last_s if np.isfinite(self._last_s) else 0.0
        self._mean_m += low_pass_weight(step_s, DEFORMATION_MEMORY_S) * (deformation_m - self._mean_m)
        self._last_s = shape.t_s
        if not self.ratio:
            return shape
        errors_m = self.ratio * np.array([self._mean_m, deformation_m - self._mean_m])
        return shape.widened(free, errors_m.T @ errors_m).in_doubt(Reason.MEMORY)

    def _begin(self) -> None:
        """Wait for the next press."""
        self._height_n: NDArray[np.float64] | None = None
        self._ended_s = np.inf
        self._rebound = 0.0

    def _follow(self, t_s: float, load_n: NDArray[np.float64]) -> None:
        """Take on the (free coordinates,) loads of one more frame."""
        height_n = self._height_n
        if height_n is None or (np.isinf(self._ended_s) and load_n @ height_n >= ENDED * (height_n @ height_n)):
            if load_n @ load_n > (self._least_n**2 if height_n is None else height_n @ height_n):
                self._height_n = load_n
            return
        self._ended_s = min(self._ended_s, t_s)
        left = float(load_n @ height_n / (height_n @ height_n))
        self._rebound = max(self._rebound, -left)
        if t_s - self._ended_s > REBOUND_S or left > 0.5:  # over, or pressed again
            self._learn(self._rebound)
            self._begin()

    def _learn(self, rebound: float) -> None:
        """Take on the ratio of one more press."""
        if rebound > 1:
            if not self.ratio:
                self._anew()
            return
        self._presses += 1
        self._sum += rebound
        self._log_odds += np.log(_density(rebound, *REMEMBERING) / _density(rebound, *CALIBRATED))
        if self._log_odds > 0:
            self.ratio = max(self.ratio, self._sum / self._presses)
        elif self._log_odds < PRIOR_LOG_ODDS:
            self.ratio = 0.0

    def _anew(self) -> None:
        """Know nothing of the strips."""
        self._presses = 0
        self._sum = 0.0
        self._log_odds = PRIOR_LOG_ODDS


def _density(ratio: float, mean: float, sigma: float, stray_share: float) -> float:
    """Return the density of a ratio from 0 to 1: a normal distribution, and a uniform one for a few presses."""
    normal = np.exp(-0.5 * ((ratio - mean) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    return float((1 - stray_share) * normal + stray_share)
