"""The health of each sensor: whether its length agrees with the other sensors and with the balance of forces.

A length l is compared with the shape that would be estimated without it. To first order this gives the studentised
residual

    z = (l - l_hat) / (sigma sqrt(r)),   r = 1 - h P h^T / sigma^2

with the redundancy r of the length; for a length that is left out r = 1, and sigma is that of l - l_hat. For a healthy
sensor z is approximately standard normal. When the mean of z over half a second is large, the frame is estimated with
and without the sensor. The sensor is left out when several frames are explained much better without it than with all
lengths, be they as exact as their sigmas say or `ALL_WRONG` times less, and better than by one change of something else
(`ChangeWatch`). A length that is wrong by 5 mm can only be explained by a residual and a false load at each end of the
tendon, while a node that is really pressed needs no wrong length. Where one end is an anchor, one false load and hardly
a residual explain it: while the other end seems to be loaded, such a sensor is checked whatever its z. Sensors that
disagree in numbers do not fail one by one: something that all have in common moves them.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..factors.noise import WeightedLengths
from ..models.estimation import HealthSettings
from ..models.structure.lengths import length_and_jacobian, propagated_variance
from ..models.structure.shape import Shape
from ..models.values.readings import Flag
from ..models.values.time_series import low_pass_weight
from .graph import GraphBuilder
from .whole_trial.own_minima import own_minima
from .whole_trial.trial_balance import TrialBalance
from .whole_trial.trial_factors import TrialFactors

ALL_WRONG = 2.0
"""Factor of all sigmas in the explanation that all sensors are a little wrong."""
LEAST_REDUNDANCY = 0.05
"""Least redundancy of a length. Below it the shape follows the length almost completely, and the first-order formula
does not predict the shape without the length."""
LOADED_SHARE = 1 / 3
"""Load at a node over the standard deviation of that of a finger, above which the sensors of tendons from an anchor to
the node are checked."""
LOADED_LOG_RATIO = 1.5
"""Log ratio expected of a healthy sensor that is checked for a load, and not because its error is large. In presses of
the twin it is 0 to 0.7, with a sensor that drifts 2 to 4."""


class SensorHealth:
    """Decides in each frame which sensors to use.

    Args:
        builder: of the frames' factors, equilibrium among them.
        settings: of this class.
        finger_n: standard deviation of the load of a finger.
    """

    def __init__(self, builder: GraphBuilder, settings: HealthSettings, finger_n: float) -> None:
        self._builder = builder
        self._settings = settings
        self._loaded_n = LOADED_SHARE * finger_n
        self._rest_covariance_m2 = builder.rest.covariance_m2
        structure = builder.structure
        count = len(structure.tendons)
        is_anchor = np.isin(structure.tendons, structure.anchors)
        self._is_from_anchor = is_anchor[:, 0] != is_anchor[:, 1]
        self._other_end = np.where(is_anchor[:, 0], structure.tendons[:, 1], structure.tendons[:, 0])
        self._mean_z = np.zeros(count)
        self._left_out = np.zeros(count, dtype=np.bool_)
        self._agrees_since_s = np.full(count, np.inf)
        self._last_s = np.nan
        self._checked_s = np.full(count, -np.inf)
        self._log_evidence = np.zeros(count)
        self._by_change = np.zeros(count)
        self.something_changed = False
        """Whether a sensor was to be left out in the latest frame, and a change elsewhere explains more."""

    def admit(self, measured: WeightedLengths) -> WeightedLengths:
        """Return the lengths without those of the sensors that are left out at present."""
        return measured.without(self._left_out, Flag.IMPLAUSIBLE) if self._left_out.any() else measured

    def use_all(self) -> None:
        """Use every sensor again, with no evidence against any."""
        self._left_out[:] = False
        self._mean_z[:] = 0.0
        self._log_evidence[:] = 0.0
        self._by_change[:] = 0.0

    def observe(self, shape: Shape, measured: WeightedLengths, change_explains: NDArray[np.float64]) -> None:
        """Update the state of each sensor by how its length, used or left out, agrees with the frame's shape.

        Args:
            shape: the estimate of a frame.
            measured: its lengths, with those that are left out.
            change_explains: (tendons,) by how much more one change explains than a fault of the sensor, see
                `ChangeWatch.explains_more`.
        """
        self.something_changed = False
        step_s = shape.t_s - self._last_s if np.isfinite(self._last_s) else 0.0
        self._last_s = shape.t_s
        z = self._studentised(shape, measured)
        seen = np.isfinite(z)
        weight = low_pass_weight(step_s, self._settings.memory_s)
        self._mean_z += np.where(seen, weight * (np.nan_to_num(z) - self._mean_z), 0.0)
        self._take_back(shape.t_s, seen)
        if shape.t_s - self._checked_s.max() >= self._settings.check_every_s:
            self._check(shape, measured, change_explains)

    def _studentised(self, shape: Shape, measured: WeightedLengths) -> NDArray[np.float64]:
        """Return (tendons,) the studentised residual z; nan where there is no length, or it joins two anchors."""
        structure = self._builder.structure
        sigma_m = measured.sigma_m
        length_m, jacobian = length_and_jacobian(shape.node_position_m, structure.tendons)
        frame_covariance_m2 = shape.covariance_m2 - self._rest_covariance_m2
        predicted = propagated_variance(jacobian, frame_covariance_m2)
        variance = np.where(np.isfinite(sigma_m), sigma_m, 1.0) ** 2
        least = LEAST_REDUNDANCY * variance
        variance = np.where(self._left_out, variance + predicted, np.maximum(variance - predicted, least))
        usable = np.isfinite(sigma_m) & structure.is_free_tendon
        error = np.where(usable, measured.lengths.length_m, np.nan) - length_m
        return np.asarray(error / np.sqrt(variance))

    def _take_back(self, t_s: float, seen: NDArray[np.bool_]) -> None:
        """Use those sensors again that have agreed for `take_back_s`."""
        agrees = seen & (np.abs(self._mean_z) < self._settings.agree_sigma)
        self._agrees_since_s = np.where(agrees, np.minimum(self._agrees_since_s, t_s), np.inf)
        self._left_out &= ~(t_s - self._agrees_since_s >= self._settings.take_back_s)

    def _check(self, shape: Shape, measured: WeightedLengths, change_explains: NDArray[np.float64]) -> None:
        """Estimate the frame with and without one sensor to be checked: of several, the one whose check is oldest.

        The evidence against a sensor accumulates as Page's cumulative sum: each check adds its log ratio minus the log
        ratio that is expected of a healthy sensor.
        """
        settings = self._settings
        used = ~self._left_out & np.isfinite(measured.sigma_m)
        suspected = (np.abs(self._mean_z) > settings.suspect_sigma) & used
        checked = suspected | (self._may_feign_load(shape) & used)
        self._log_evidence *= checked
        self._by_change *= checked
        usable = np.isfinite(measured.sigma_m) & self._builder.structure.is_free_tendon
        alike = (suspected | self._left_out)[usable].sum() > settings.alike_share * usable.sum()
        if alike or not checked.any():
            return
        suspect = int(np.argmin(np.where(checked, self._checked_s, np.inf)))
        self._checked_s[suspect] = shape.t_s
        admitted = self.admit(measured)
        without = admitted.without(np.arange(len(self._left_out)) == suspect)
        with_all, all_wrong, without_it = self._least_errors([admitted, admitted.scaled(ALL_WRONG), without], shape)
        log_ratio = min(with_all, all_wrong + admitted.count * np.log(ALL_WRONG)) - without_it
        expected = settings.expected_log_ratio if suspected[suspect] else LOADED_LOG_RATIO
        self._log_evidence[suspect] = max(self._log_evidence[suspect] + log_ratio - expected, 0.0)
        self._by_change[suspect] += change_explains[suspect]
        if self._log_evidence[suspect] >= settings.log_ratio:
            self.something_changed = bool(self._by_change[suspect] > 0)
            self._left_out[suspect] = not self.something_changed
            self._agrees_since_s[suspect] = np.inf
            self._log_evidence[suspect] = self._by_change[suspect] = 0.0

    def _may_feign_load(self, shape: Shape) -> NDArray[np.bool_]:
        """Return (tendons,) which of them run from an anchor to a node that seems to be loaded."""
        if shape.loads is None:
            return np.zeros(len(self._other_end), dtype=np.bool_)
        load_n = np.nan_to_num(np.linalg.norm(shape.loads.force_n, axis=1))
        return np.asarray(self._is_from_anchor & (load_n > self._loaded_n)[self._other_end])

    def _least_errors(self, explanations: Sequence[WeightedLengths], shape: Shape) -> list[float]:
        """Return the least error of the frame's own factors near its shape, with each of several weights of lengths."""
        count = len(explanations)
        factors = TrialFactors(self._builder, explanations, TrialBalance.of_newest(self._builder, count))
        error: list[float] = own_minima(factors, np.tile(shape.node_position_m, (count, 1, 1)))[1].tolist()
        return error
