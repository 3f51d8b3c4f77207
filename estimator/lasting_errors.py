"""What a frame alone does not tell of its errors: those that grow with the deformation and with its speed.

They last from frame to frame, and all strips err alike, so that neither many sensors nor many frames average them:

    C' = C_rest + s^2 (C - C_rest) + kappa^2 u u^T + kappa_c^2 sum m m^T + tau^2 (v v^T + <v v^T>)

with u the displacement of all nodes from the rest shape, m what remains of it after two low-pass filters, for each time
constant of `CREEP_S`, v their velocity, and <> the mean over the frames of a second: the last one live, half of one
before and after in batch. Where all tendons are stretched, none drifts by itself, and the status is `ok`, s is
`Doubt.error_scale`: sensors that agree with each other and with the forces better than their sigmas say have smaller
errors. Elsewhere it is 1.

In the calibration's recordings of irregular motion, changes of strain of 0.5 to 1.5 % are shown 7 % too small in the
mean of 17 recordings, and 1 to 2 % too small where they are larger, by 4 % more or less from strip to strip; the
balance of forces, in which no load is more probable than one, draws shapes to rest by 1 to 5 % even with true lengths.
The error of strain grows with its rate by 0.035 to 0.06 s times that rate, with either sign. Where a hand swings a node
to and fro, the error is largest where it turns, and v is zero there. Strips that are held creep for longer than in
those recordings, in which they move all the time, and remember it: in presses of the twin that last for 8 s, lengths
lose a seventh to a third, in those of a second hardly anything. Of lengths that no strips tell, only the errors of the
balance are left.
"""

from collections import deque

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
"""kappa_c, the standard deviation of what strips creep while they are held, each four times as long, over the
deformation: creep goes on with the logarithm of time."""
CREEP_S = np.array([2.0, 8.0, 32.0])
"""Time constants of both filters: m of the first is 0.1 of a deformation that has lasted for 1 s, and 0.9 after 8 s."""
RATE_S = 0.05
"""tau in batch, the standard deviation of the error that comes from motion over the velocity."""
LIVE_RATE_S = 0.1
"""tau live, where no later frame shows how the motion went on."""
SWING_WINDOW_S = 1.0
"""Time over whose frames the velocities are averaged: the period of the slowest swing that strips follow too late."""
VELOCITY_S = 0.1
"""Time constant of the smoothing of live shapes before their velocity is taken."""


def frames_near(t_s: NDArray[np.float64]) -> list[slice]:
    """Return of each of (frames,) times the frames of the second around it, itself included."""
    first, end = (np.searchsorted(t_s, t_s + side * SWING_WINDOW_S / 2) for side in (-1, 1))
    return [slice(*ends) for ends in zip(first.tolist(), end.tolist(), strict=True)]


class LastingErrors:
    """Turns the covariances of single frames into those of shapes in a trial."""

    def __init__(self, structure: Structure, rest: RestShape) -> None:
        self._free = structure.free_coordinates
        self._rest_m = rest.node_position_m.reshape(-1)[self._free]
        self._rest_m2 = rest.covariance_m2[np.ix_(self._free, self._free)]
        self._balance_share = BALANCE_SHARE if rest.mechanics else 0.0
        self._velocity = SmoothedRate(len(self._free), VELOCITY_S)
        self._velocities: deque[tuple[float, NDArray[np.float64]]] = deque()
        self._held_m = np.zeros((2, len(CREEP_S), len(self._free)))
        self._last_s = np.nan

    def observe(self, shape: Shape, error_scale: float) -> Shape:
        """Return a live shape with these errors in its covariance; shapes are given in order of time.

        Args:
            shape: the shape.
            error_scale: see `Doubt`.
        """
        step_s = VELOCITY_S if np.isnan(self._last_s) else shape.t_s - self._last_s
        position_m = shape.node_position_m.reshape(1, -1)[:, self._free]
        velocity = self._velocity.run(position_m, np.array([[step_s]]))[0]
        self._velocities.append((shape.t_s, velocity))
        while self._velocities[0][0] < shape.t_s - SWING_WINDOW_S:
            self._velocities.popleft()
        near_m_per_s = np.array([each for _, each in self._velocities])
        return self._widened(shape, LIVE_RATE_S * _motion_rows(velocity, near_m_per_s), error_scale)

    def of_trial(
        self,
        shape: Shape,
        velocity_m_per_s: NDArray[np.float64],
        near_m_per_s: NDArray[np.float64],
        error_scale: float,
    ) -> Shape:
        """Return a shape of a whole trial with these errors in its covariance.

        Args:
            shape: the shape; shapes are given in order of time.
            velocity_m_per_s: (nodes, 3) its velocity.
            near_m_per_s: (frames, nodes, 3) the velocities of the frames around it, itself included.
            error_scale: see `Doubt`.
        """
        velocity, near = velocity_m_per_s.reshape(-1), near_m_per_s.reshape(len(near_m_per_s), -1)
        return self._widened(shape, RATE_S * _motion_rows(velocity[self._free], near[:, self._free]), error_scale)

    def _widened(self, shape: Shape, of_motion_m: NDArray[np.float64], error_scale: float) -> Shape:
        """Return the shape with the errors that last, and with those of its frame times `error_scale`.

        Of a shaken robot the covariance is that of its swings already.

        Args:
            shape: the shape.
            of_motion_m: (rows, free) rows whose squares sum up to tau^2 (v v^T + <v v^T>).
            error_scale: see `Doubt`.
        """
        deformation_m = shape.node_position_m.reshape(-1)[self._free] - self._rest_m
        if not np.isnan(self._last_s):
            weight = low_pass_weight(np.array(shape.t_s - self._last_s), CREEP_S[:, None])
            once_m, twice_m = self._held_m
            once_m += weight * (deformation_m - once_m)
            twice_m += weight * (once_m - twice_m)
        self._last_s = shape.t_s
        if shape.doubt is Reason.MOTION:
            return shape
        if shape.lengths.of_strips:
            parts_m = np.vstack([DEFORMATION_SHARE * deformation_m, CREEP_SHARE * self._held_m[1], of_motion_m])
        else:
            parts_m = self._balance_share * deformation_m[None]
        added_m2 = parts_m.T @ parts_m
        if error_scale < 1 and _errors_pass(shape):
            of_frame_m2 = shape.covariance_m2[self._free[:, None], self._free] - self._rest_m2
            added_m2 -= (1 - error_scale**2) * of_frame_m2
        return shape.widened(self._free, added_m2)


def _motion_rows(velocity: NDArray[np.float64], near: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (1 + frames, free) rows whose squares sum up to v v^T + <v v^T>."""
    return np.vstack([velocity, near / np.sqrt(len(near))])


def _errors_pass(shape: Shape) -> bool:
    """Return whether the errors of lengths pass, so that lengths that agree tell how large they are.

    Those of strips that are bent, or may be, or drift by themselves, last, and so do those of which a doubt tells.
    """
    lengths = shape.lengths
    bent = (lengths.mode == BENDING) | (lengths.flags & int(Flag.AMBIGUOUS) != 0)
    return (
        lengths.of_strips
        and shape.status is Status.OK
        and not lengths.rest_in_doubt
        and not (bent & lengths.usable).any()
        and (lengths.drift is None or not lengths.drift.is_apart)
    )
