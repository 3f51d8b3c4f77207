"""Which ranges to trust: those of beacons that agree with the robot at rest, and that do not stay off later.

At rest nodes and beacons are where they are told to be, so that the mean error of the ranges of a pair is its offset,
of standard deviation sigma_o, and the noise of n ranges. With z its size in standard deviations, at most `MOST_AT_REST`
for reflections, the sum of (z - mean z)^2 over the pairs of each beacon has a chi-square distribution; so has the sum
of (m / sigma_o)^2 over beacons, with the median m of their pairs, which may all have the same offset. Where one of both
is improbable, the frame of a recording's beacons, their order or unit is another one than told, and none of its ranges
is used.

Later somebody may stand between a beacon and the robot: all ranges of the beacon are too long, for seconds, each by
less than an outlier. The mean e of their errors by the predicted pose over `MEMORY_S`, and its variance

    J P J^T + sigma^2 sum w^2 / (sum w)^2

with the weights w of the readings in the mean, tell it: what the pose is wrong by, all readings have in common, and
their noise they have not. A beacon that is off by more than `OFF_SIGMA` is left out until it is not. Where half of the
beacons or more are off, the pose may be what is wrong: their ranges are used, and in doubt from then on, because the
offsets that are estimated may be what was wrong.
"""

from collections import defaultdict
from collections.abc import Mapping

import numpy as np
from scipy.special import chdtrc

from ...factors.range import OUTLIER, range_error
from ...models.pose.pose_settings import PoseSettings
from ...models.values.aids import RangeReading
from .prediction import Frame, Prediction

MOST_AT_REST = 3.0
"""Error of a pair at rest, in standard deviations, as which a larger one counts."""
MISPLACED_PROBABILITY = 1e-4
"""Probability of the errors at rest below which beacons are elsewhere than told."""
MEMORY_S = 1.0
"""Time constant of the mean error of a beacon's ranges."""
OFF_SIGMA = 4.0
"""Mean error of the ranges of a beacon, in standard deviations, beyond which it is off."""


class _BeaconErrors:
    """The mean error of the ranges of one beacon."""

    def __init__(self) -> None:
        self._last_s = -np.inf
        self._mean_m = 0.0
        self._weight = 0.0
        self._squared_weight = 0.0
        self._sigma_m = np.inf

    def observe(self, t_s: float, error_m: float, pose_variance_m2: float, sigma_m: float) -> None:
        """Take on the error of one more range; that of a single reflection counts as an outlier's, and no more."""
        most_m = OUTLIER * float(np.sqrt(pose_variance_m2 + sigma_m**2))
        kept = float(np.exp(-(t_s - self._last_s) / MEMORY_S))
        self._last_s = t_s
        self._weight = kept * self._weight + 1.0
        self._squared_weight = kept**2 * self._squared_weight + 1.0
        self._mean_m += (float(np.clip(error_m, -most_m, most_m)) - self._mean_m) / self._weight
        noise_m2 = sigma_m**2 * self._squared_weight / self._weight**2
        self._sigma_m = float(np.sqrt(pose_variance_m2 + noise_m2))

    @property
    def is_off(self) -> bool:
        """Whether the ranges are too long or too short in the mean."""
        return abs(self._mean_m) > OFF_SIGMA * self._sigma_m


class RangeTrust:
    """Follows which ranges to trust, frame by frame."""

    def __init__(
        self, number_of_pair: Mapping[tuple[int, int, int], int], rest_until_s: float, settings: PoseSettings
    ) -> None:
        """Prepare for some pairs of beacon and node, and their places among the offsets of the state."""
        self._number_of_pair = number_of_pair
        self._rest_until_s = rest_until_s
        self._settings = settings
        self._at_rest_m: dict[tuple[int, int, int], list[float]] = defaultdict(list)
        self._errors = {pair[:2]: _BeaconErrors() for pair in number_of_pair}
        self._misplaced: set[int] = set()
        self._were_many = False
        self.in_doubt = False
        """Whether a recording's beacons are elsewhere than told, or half of all beacons have been off together."""

    def left_out(self, frame: Frame, predicted: Prediction) -> list[RangeReading]:
        """Return the ranges of a frame that are not to be used.

        Args:
            frame: the frame.
            predicted: what is expected of it.
        """
        ranges = frame.ranges
        if not ranges:
            return []
        rests = frame.t_s < self._rest_until_s
        for reading in ranges:
            self._observe(reading, predicted, rests=rests)
        if rests:
            self._misplaced = {number for number, _ in self._errors if self._is_misplaced(number)}
        off = {beacon for beacon, errors in self._errors.items() if errors.is_off}
        are_many = 2 * len(off) >= len(self._errors)
        self._were_many |= are_many and not rests
        self.in_doubt = bool(self._misplaced) or self._were_many
        return [
            reading
            for reading in ranges
            if reading.pair[0] in self._misplaced or (reading.pair[:2] in off and not are_many)
        ]

    def _observe(self, reading: RangeReading, predicted: Prediction, *, rests: bool) -> None:
        """Take on one more range, while the robot rests or later."""
        number = self._number_of_pair[reading.pair]
        error_m, jacobian = range_error(predicted.placed, reading, number)
        if rests:
            self._at_rest_m[reading.pair].append(error_m + float(predicted.placed.state.range_offset_m[number]))
        variance_m2 = float(jacobian @ predicted.covariance @ jacobian)
        self._errors[reading.pair[:2]].observe(reading.t_s, error_m, variance_m2, self._settings.range_m)

    def _is_misplaced(self, number: int) -> bool:
        """Return whether the beacons of a recording are elsewhere than told, by their ranges at rest."""
        offset_m, noise_m = self._settings.range_offset_m, self._settings.range_m
        of_beacon: dict[int, list[tuple[float, float]]] = defaultdict(list)
        for (recording, beacon, _), errors_m in self._at_rest_m.items():
            if recording == number:
                sigma_m = float(np.hypot(offset_m, noise_m / np.sqrt(len(errors_m))))
                of_beacon[beacon].append((float(np.mean(errors_m)), sigma_m))
        within = among = 0.0
        for pairs in of_beacon.values():
            error_m, sigma_m = np.array(pairs).T
            z = np.clip(error_m / sigma_m, -MOST_AT_REST, MOST_AT_REST)
            within += float(np.sum((z - z.mean()) ** 2))
            among += float(np.median(error_m) / offset_m) ** 2
        degrees = sum(map(len, of_beacon.values())) - len(of_beacon)
        are_improbable = chdtrc([degrees, len(of_beacon)], [within, among]) < MISPLACED_PROBABILITY
        return bool(are_improbable.any())
