"""What a frame alone does not tell of its errors: those that grow with the deformation and with its speed.

They last from frame to frame, and all strips err alike, so that neither many sensors nor many frames average them:

    C' = C_rest + a (C - C_rest) + kappa^2 u u^T + kappa_c^2 m m^T + tau^2 v v^T

with u the displacement of all nodes from the rest shape, m what remains of it after two low-pass filters of 2 s, and v
their velocity; a is `AVERAGED` in batch, where all tendons are stretched and the status is `ok`, and else 1.

In the calibration's recordings of irregular motion, changes of strain of 0.5 to 1.5 % are shown 7 % too small in the
mean of 17 recordings, and 1 to 2 % too small where they are larger, by 4 % more or less from strip to strip; the
balance of forces, in which no load is more probable than one, draws shapes to rest by 1 to 5 % even with true lengths.
The error of strain grows with its rate by 0.035 to 0.06 s times that rate, with either sign. Strips that are held creep
for longer than in those recordings, in which they move all the time, and remember it: in presses of the twin that last
for 8 s, lengths lose a seventh to a third, in those of a second hardly anything. Of lengths that no strips tell, only
the errors of the balance are left.
"""

import numpy as np
from numpy.typing import NDArray

from ..models.structure.rest_shape import RestShape
from ..models.structure.shape import Reason, Shape, Status
from ..models.structure.structure import Structure
from ..models.values.readings import BENDING, Flag
from ..models.values.time_series import SmoothedRate, low_pass_weight

DEFORMATION_SHARE = 0.07
"""kappa, the standard deviation of the error that all strips share over the deformation."""
BALANCE_SHARE = 0.05
"""The part of it that the balance of forces makes."""
CREEP_SHARE = 0.2
"""kappa_c, the standard deviation of what strips creep while they are held over the deformation."""
CREEP_S = 2.0
"""Time constant of both filters, of which m is 0.1 of a deformation that has lasted for 1 s, and 0.9 of one of 8 s."""
RATE_S = 0.05
"""tau, the standard deviation of the error that comes from motion over the velocity."""
AVERAGED = 0.7
"""Share of the variance of one frame that is left where the smoother averages frames before and after it: of the errors
of stretched tendons, a mean over half a second leaves half of the variance at rest and 0.6 to 0.7 of it between
presses; that of loads, rods and rest shape is not averaged."""
VELOCITY_S = 0.1
"""Time constant of the smoothing of live shapes before their velocity is taken."""
HALF_S = 0.25
"""Time before and after a frame over which the smoother averages."""
MANY = 5
"""Number of frames in that time, the frame included, from which on their noise is averaged."""


def averaged_frames(t_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (frames,) whether there are many frames both before and after each: the last one is as it is live."""
    frame = np.arange(len(t_s))
    after = np.searchsorted(t_s, t_s + HALF_S) - frame
    before = frame + 1 - np.searchsorted(t_s, t_s - HALF_S)
    return np.asarray(np.minimum(before, after) >= MANY)


class LastingErrors:
    """Turns the covariances of single frames into those of shapes in a trial."""

    def __init__(self, structure: Structure, rest: RestShape) -> None:
        self._free = structure.free_coordinates
        self._rest_m = rest.node_position_m.reshape(-1)[self._free]
        self._rest_m2 = rest.covariance_m2[np.ix_(self._free, self._free)]
        self._balance_share = BALANCE_SHARE if rest.mechanics else 0.0
        self._velocity = SmoothedRate(len(self._free), VELOCITY_S)
        self._held_m = np.zeros((2, len(self._free)))
        self._last_s = np.nan

    def observe(self, shape: Shape) -> Shape:
        """Return a live shape with these errors in its covariance; shapes are given in order of time."""
        step_s = VELOCITY_S if np.isnan(self._last_s) else shape.t_s - self._last_s
        position_m = shape.node_position_m.reshape(1, -1)[:, self._free]
        return self._widened(shape, self._velocity.run(position_m, np.array([[step_s]]))[0])

    def of_trial(self, shape: Shape, velocity_m_per_s: NDArray[np.float64], *, is_averaged: bool) -> Shape:
        """Return a shape of a whole trial with these errors in its covariance.

        Args:
            shape: the shape; shapes are given in order of time.
            velocity_m_per_s: (nodes, 3) its velocity.
            is_averaged: whether the smoother has averaged the noise of many frames around it.
        """
        velocity_m_per_s = velocity_m_per_s.reshape(-1)[self._free]
        return self._widened(shape, velocity_m_per_s, of_noise=is_averaged and _is_stretched(shape))

    def _widened(self, shape: Shape, velocity_m_per_s: NDArray[np.float64], *, of_noise: bool = False) -> Shape:
        """Return the shape with the errors that last, and without what other frames average of its noise.

        Of a shaken robot the covariance is that of its swings already.
        """
        deformation_m = shape.node_position_m.reshape(-1)[self._free] - self._rest_m
        if not np.isnan(self._last_s):
            weight = low_pass_weight(np.array(shape.t_s - self._last_s), CREEP_S)
            once_m, twice_m = self._held_m
            once_m += weight * (deformation_m - once_m)
            twice_m += weight * (once_m - twice_m)
        self._last_s = shape.t_s
        if shape.doubt is Reason.MOTION:
            return shape
        if shape.lengths.of_strips:
            parts_m = np.stack(
                [DEFORMATION_SHARE * deformation_m, CREEP_SHARE * self._held_m[1], RATE_S * velocity_m_per_s]
            )
        else:
            parts_m = self._balance_share * deformation_m[None]
        added_m2 = parts_m.T @ parts_m
        if of_noise:
            of_frame_m2 = shape.covariance_m2[self._free[:, None], self._free] - self._rest_m2
            added_m2 -= (1 - AVERAGED) * of_frame_m2
        return shape.widened(self._free, added_m2)


def _is_stretched(shape: Shape) -> bool:
    """Return whether strips alone are read, none is or may be bent, whose errors last, and nothing is in doubt."""
    lengths = shape.lengths
    bent = (lengths.mode == BENDING) | (lengths.flags & int(Flag.AMBIGUOUS) != 0)
    return (
        lengths.of_strips
        and shape.status is Status.OK
        and not lengths.rest_in_doubt
        and not (bent & lengths.usable).any()
    )
