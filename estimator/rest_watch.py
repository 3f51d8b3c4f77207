"""Whether the lengths that are read at rest are those of the rest shape.

What the front end tares agrees with the rest shape by construction, and it tells itself whether its readings could be
those of this structure. Lengths that are recorded as such are compared here: with the mean m_e over the time at rest of
tendon e and the rest shape's length l_e, at least half of the tendons have |m_e - l_e| > 5 sigma_e when the structure
is another one, columns are exchanged, or there was no rest.
"""

import numpy as np

from ..models.structure.shape import Shape
from ..models.values.readings import RestLengths

REST_APART_SIGMA = 5.0
"""Number of standard deviations beyond which a tendon's length at rest is not that of the rest shape."""


class RestWatch:
    """Compares the lengths at rest of one shape after another with those of the rest shape."""

    def __init__(self, rest: RestLengths) -> None:
        self._rest = rest
        self._start_s: float | None = None
        self._count = np.zeros(len(rest.length_m))
        self._misfit_m = np.zeros(len(rest.length_m))
        self.in_doubt = False
        """Whether at least half of the tendons do not fit."""

    def observe(self, shape: Shape) -> None:
        """Take on the lengths of one more frame while the structure rests."""
        if self._start_s is None:
            self._start_s = shape.t_s
        if shape.t_s - self._start_s >= self._rest.seconds:
            return
        length_m, sigma_m = shape.lengths.length_m, shape.lengths.sigma_m
        read = np.isfinite(length_m) & np.isfinite(sigma_m)
        self._count += read
        error_m = length_m[read] - self._rest.length_m[read]
        self._misfit_m[read] += (error_m - self._misfit_m[read]) / self._count[read]
        beyond = np.abs(self._misfit_m[read]) > REST_APART_SIGMA * np.hypot(sigma_m[read], self._rest.sigma_m[read])
        self.in_doubt = bool(2 * beyond.sum() >= read.sum() > 0)
