"""Which ranges to trust: those of beacons that agree with the robot at rest, and that do not stay off later.

At rest nodes and beacons are where they are told to be, so that the mean error e of the n ranges of a pair is its
offset, with sigma^2 = sigma_o^2 + sigma_y^2 / n. With z = e / sigma, at most `MOST_AT_REST` for reflections, the sum of
(z - mean z)^2 over the pairs of each beacon has a chi-square distribution; so has the sum over beacons of m^2, with the
median m of the z of their pairs, which may all have the same offset. Where one of both is improbable, and larger than
offsets of `LARGER` sigma_o would make it, the frame of a recording's beacons, their order or unit is another one than
told, and none of its ranges is used.

Later somebody may stand between a beacon and the robot: all ranges of the beacon are too long, for seconds, each by
less than an outlier. The mean e of their errors by the predicted pose over `RECENT_RANGES_S`, and its variance

    J P J^T + FREE_M^2 + sigma_y^2 sum w^2 / (sum w)^2

with the weights w of the readings in the mean, and without the error of the beacon in J, tell it: what the pose is
wrong by, all readings have in common, and their noise they have not. A beacon that is off by more than `OFF_SIGMA` is
left out until it is not. Where half of the beacons that are read, or more, are off, the pose may be what is wrong:
their ranges are used, and in doubt from then on, because the offsets that are estimated may be what was wrong; until a
search over all headings finds a pose that they fit.
"""

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ....factors.range import OUTLIER, range_error
from ....models.pose.pose_settings import PoseSettings
from ....models.values.aids import RangeReading
from ....models.values.chi_squared import chi_squared_quantile
from ..prediction import Frame, Prediction

MOST_AT_REST = 3.0
"""Error of a pair at rest, in standard deviations, as which a larger one counts."""
MISPLACED_PROBABILITY = 1e-4
"""Probability of the errors at rest below which beacons are elsewhere than told."""
LARGER = 1.7
"""Ratio of offsets to their standard deviation as told that is no contradiction yet."""
LEAST_RANGES = 10
"""Number of ranges of a beacon at rest from which they count: a single one may be reflected."""
RECENT_RANGES_S = 1.0
"""Time constant of the mean error of a beacon's ranges, and time after which a beacon that is silent says nothing."""
FREE_M = 0.03
"""Standard deviation of what all ranges of a beacon that nobody stands before are wrong by."""
OFF_SIGMA = 4.0
"""Mean error of the ranges of a beacon, in standard deviations, beyond which it is off."""


@dataclass(slots=True)
class _PairAtRest:
    """The mean error of the ranges of one pair at rest."""

    count: int = 0
    mean_m: float = 0.0

    def observe(self, error_m: float) -> None:
        """Take on the error of one more range, without an offset."""
        self.count += 1
        self.mean_m += (error_m - self.mean_m) / self.count


@dataclass(slots=True)
class _Recent:
    """The mean error of the ranges of one beacon."""

    latest_s: float = -np.inf
    mean_m: float = 0.0
    weight: float = 0.0
    squared_weight: float = 0.0
    sigma_m: float = np.inf

    def observe(self, t_s: float, error_m: float, pose_variance_m2: float, sigma_m: float) -> None:
        """Take on the error of one more range; that of a single reflection counts as an outlier's, and no more."""
        most_m = OUTLIER * float(np.sqrt(pose_variance_m2 + sigma_m**2))
        kept = float(np.exp(-(t_s - self.latest_s) / RECENT_RANGES_S))
        self.latest_s = t_s
        self.weight = kept * self.weight + 1.0
        self.squared_weight = kept**2 * self.squared_weight + 1.0
        self.mean_m += (float(np.clip(error_m, -most_m, most_m)) - self.mean_m) / self.weight
        noise_m2 = sigma_m**2 * self.squared_weight / self.weight**2
        self.sigma_m = float(np.sqrt(pose_variance_m2 + noise_m2))

    @property
    def is_off(self) -> bool:
        """Whether the ranges are too long or too short in the mean."""
        return abs(self.mean_m) > OFF_SIGMA * self.sigma_m


class RangeTrust:
    """Follows which ranges to trust, frame by frame."""

    def __init__(
        self,
        numbers_of_pair: Mapping[tuple[int, int, int], tuple[int, int]],
        rest_until_s: float,
        settings: PoseSettings,
    ) -> None:
        """Prepare for some pairs of beacon and node, and their places among the offsets of the state."""
        self._numbers_of_pair = numbers_of_pair
        self._rest_until_s = rest_until_s
        self._settings = settings
        self._at_rest: dict[tuple[int, int, int], _PairAtRest] = defaultdict(_PairAtRest)
        self._recent: dict[tuple[int, int], _Recent] = defaultdict(_Recent)
        self._misplaced: set[int] = set()
        self._were_many = False

    @property
    def in_doubt(self) -> bool:
        """Whether a recording's beacons are elsewhere than told, or half of those read have been off together."""
        return bool(self._misplaced) or self._were_many

    def trust_again(self) -> None:
        """Take note that the ranges of all beacons fit together, as a search over all headings has found.

        What seemed to be off before was the pose.
        """
        self._recent.clear()
        self._were_many = False

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
            recordings = {recording for recording, _ in self._recent}
            self._misplaced = {recording for recording in recordings if self._is_misplaced(recording)}
        read = {
            beacon: recent
            for beacon, recent in self._recent.items()
            if beacon[0] not in self._misplaced and frame.t_s - recent.latest_s < RECENT_RANGES_S
        }
        off = {beacon for beacon, recent in read.items() if recent.is_off}
        are_many = bool(off) and 2 * len(off) >= len(read)
        self._were_many |= are_many and not rests
        return [
            reading
            for reading in ranges
            if reading.pair[0] in self._misplaced or (reading.pair[:2] in off and not are_many)
        ]

    def _observe(self, reading: RangeReading, predicted: Prediction, *, rests: bool) -> None:
        """Take on one more range, while the robot rests or later."""
        numbers = self._numbers_of_pair[reading.pair]
        error_m, jacobian, of_shape = range_error(predicted.placed, reading, numbers)
        if not np.isfinite(error_m):
            return
        if rests:
            self._at_rest[reading.pair].observe(error_m + float(predicted.placed.state.range_offset_m[numbers[0]]))
        jacobian[predicted.placed.state.layout.beacon_error] = 0.0
        variance_m2 = float(jacobian @ predicted.covariance @ jacobian) + of_shape + FREE_M**2
        self._recent[reading.pair[:2]].observe(reading.t_s, error_m, variance_m2, self._settings.range_m)

    def _is_misplaced(self, recording: int) -> bool:
        """Return whether the beacons of a recording are elsewhere than told, by their ranges at rest."""
        offset_m, noise_m = self._settings.range_offset_m, self._settings.range_m
        z_of_beacon: dict[int, list[float]] = defaultdict(list)
        count: Counter[int] = Counter()
        for (number, beacon, _), pair in self._at_rest.items():
            if number == recording:
                z_of_beacon[beacon].append(pair.mean_m / float(np.hypot(offset_m, noise_m / np.sqrt(pair.count))))
                count[beacon] += pair.count
        known = [np.array(z) for beacon, z in z_of_beacon.items() if count[beacon] >= LEAST_RANGES]
        counted = [np.clip(z, -MOST_AT_REST, MOST_AT_REST) for z in known]
        among = sum(float(np.median(z)) ** 2 for z in known)
        within = sum(float(np.sum((z - z.mean()) ** 2)) for z in counted)
        return _is_improbable(among, len(known)) or _is_improbable(within, sum(len(z) - 1 for z in known))


def _is_improbable(squares: float, degrees: int) -> bool:
    """Return whether a sum of squares is improbable, and larger than that of larger offsets."""
    if degrees == 0:
        return False
    return squares >= max(LARGER**2 * degrees, float(chi_squared_quantile(1 - MISPLACED_PROBABILITY, degrees)))
