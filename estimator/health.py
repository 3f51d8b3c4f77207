"""The health of each sensor: whether the others, and the balance of forces, bear its length out.

A length l is judged by what the shape would be without it. To first order that is the studentised residual

    z = (l - l_hat) / (sigma sqrt(r)),   r = 1 - h P h^T / sigma^2 (its redundancy; r = 1 when it is left out, sigma
                                                                   then that of l - l_hat)

which is about a standard normal for a healthy sensor. Where the mean of z over half a second stands out, the frame is
estimated with and without the sensor, and it is left out when doing without explains several frames much better: a
wrong length of 5 mm needs a residual and a phantom load at either end, one pressed node needs no wrong length. Sensors
that stand out in numbers do not fail one by one: something common moves them, and to leave any out loosens the shape.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..factors.noise import tendon_sigma_m
from ..models.estimation import HealthSettings
from ..models.structure.lengths import length_jacobian
from ..models.structure.shape import Shape
from ..models.values.readings import Flag, TendonLengths
from .graph import GraphBuilder

LEAST_REDUNDANCY = 0.05
"""Below, the shape takes the length as it comes, and first order says nothing of what it would be without."""


class SensorHealth:
    """Decides, frame by frame, whose lengths to use."""

    def __init__(self, builder: GraphBuilder, settings: HealthSettings) -> None:
        self._builder, self._settings = builder, settings
        self._held_m2 = builder.rest.covariance_m2
        count = len(builder.structure.tendons)
        self._mean_z = np.zeros(count)
        self._out = np.zeros(count, dtype=np.bool_)
        self._agrees_since_s = np.full(count, np.inf)
        self._last_s, self._checked_s = np.nan, np.full(count, -np.inf)
        self._against = np.zeros(count)

    def admit(self, lengths: TendonLengths) -> TendonLengths:
        """Return the lengths without those of sensors that are left out."""
        if not self._out.any():
            return lengths
        flags = lengths.flags | np.where(self._out, int(Flag.IMPLAUSIBLE), 0)
        return replace(lengths, sigma_m=np.where(self._out, np.inf, lengths.sigma_m), flags=flags)

    def observe(self, shape: Shape, lengths: TendonLengths) -> None:
        """Take note of how a frame's lengths, left out or not, agree with its shape."""
        step_s = lengths.t_s - self._last_s if np.isfinite(self._last_s) else 0.0
        self._last_s = lengths.t_s
        z = self._studentised(shape, lengths)
        seen = np.isfinite(z)
        weight = -np.expm1(-step_s / self._settings.memory_s)
        self._mean_z += np.where(seen, weight * (np.nan_to_num(z) - self._mean_z), 0.0)
        self._take_back(lengths.t_s, seen)
        if lengths.t_s - self._checked_s.max() >= self._settings.check_every_s:
            self._check(shape, lengths)

    def _studentised(self, shape: Shape, lengths: TendonLengths) -> NDArray[np.float64]:
        structure = self._builder.structure
        sigma_m = tendon_sigma_m(lengths, self._builder.noise)
        jacobian = length_jacobian(shape.node_position_m, structure.tendons).reshape(len(sigma_m), -1)
        own = shape.covariance_m2 - self._held_m2
        predicted = np.sum((jacobian @ own) * jacobian, axis=-1)
        variance = np.where(np.isfinite(sigma_m), sigma_m, 1.0) ** 2
        least = LEAST_REDUNDANCY * variance
        variance = np.where(self._out, variance + predicted, np.maximum(variance - predicted, least))
        usable = np.isfinite(sigma_m) & structure.is_free_tendon
        error = np.where(usable, lengths.length_m, np.nan) - structure.tendon_length_m(shape.node_position_m)
        return np.asarray(error / np.sqrt(variance))

    def _take_back(self, t_s: float, seen: NDArray[np.bool_]) -> None:
        """Take sensors back that have agreed for long enough."""
        agrees = seen & (np.abs(self._mean_z) < self._settings.agree_sigma)
        self._agrees_since_s = np.where(agrees, np.minimum(self._agrees_since_s, t_s), np.inf)
        self._out &= ~(t_s - self._agrees_since_s >= self._settings.take_back_s)

    def _check(self, shape: Shape, lengths: TendonLengths) -> None:
        """Estimate the frame without a sensor that stands out, if one does: the one not checked for longest.

        What speaks against it adds up (Page's cumulative sum): each check adds its log ratio less what is expected.
        """
        settings = self._settings
        stands_out = (np.abs(self._mean_z) > settings.suspect_sigma) & ~self._out & np.isfinite(lengths.sigma_m)
        self._against *= stands_out
        usable = np.isfinite(lengths.sigma_m) & self._builder.structure.is_free_tendon
        alike = (stands_out | self._out)[usable].sum() > settings.alike_share * usable.sum()
        if not stands_out.any() or alike:
            return
        suspect = int(np.argmin(np.where(stands_out, self._checked_s, np.inf)))
        self._checked_s[suspect] = lengths.t_s
        admitted = self.admit(lengths)
        without = replace(admitted, sigma_m=np.where(np.arange(len(self._out)) == suspect, np.inf, admitted.sigma_m))
        start_m = shape.node_position_m
        gain = self._builder.minimum(admitted, start_m).error - self._builder.minimum(without, start_m).error
        self._against[suspect] = max(self._against[suspect] + gain - settings.expected_log_ratio, 0.0)
        if self._against[suspect] >= settings.log_ratio:
            self._out[suspect] = True
            self._agrees_since_s[suspect] = np.inf
            self._against[suspect] = 0.0
