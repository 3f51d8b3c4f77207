"""What hands do to a structure that hangs: their torque about the suspension, and the swing that they leave.

One hand at most loads one node, or none does. A hand that holds the structure aside changes two things: it loads a
node, and it turns the structure, so that the weight has another direction. Under the hypothesis k the outer forces are,
with the force f at the node k, the weight F_0 of a structure that hangs without hands, and the tilt a at which torques
balance (see `models.structure.suspension`),

    F = F_0 + G a(f) + E_k f,     a(f) = -H^-1 A_k f / W,     f ~ N(0, L^2),     L of several strengths

and the balance of internal forces says how probable F is, with M and v as in `estimator.free_standing.resting_faces`:

    log L_k = 1/2 g^T (1 + B^T M B)^-1 g - 1/2 log |1 + B^T M B| + const,   B = L dF / df,   g = -B^T (v + M F(0))

The hypotheses form a hidden Markov model: a hand stays for a while. The torque of hands and its covariance are those of
the mixture of all of them, so that hands which forces do not exclude are in the covariance.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ...models.estimation import DoubtSettings
from ...models.values.rotations import cross_matrix
from ...models.values.time_series import Regimes
from ..free_standing.resting_faces import Balance

LEAST_LEVER = 1e-3
"""Least lever of the weight over the size of the structure: one whose weight is at the suspension is turned by any."""
LEAST_RESTORING = 0.3
"""Least torque by which the weight restores, as a share of that of a structure that hangs straight: at 70 degrees."""
STRENGTHS = np.array([0.2, 1.0])
"""Strengths of hands, over that of a finger: a weak one tilts a light robot, too."""
HOLD_S = 2.0
"""Time for which a hand stays, or stays away."""
ALIKE_S = 0.5
"""Time over which the evidence of successive looks is the same."""
MOST_LOG_RATIO = 30.0
"""Limit of the log ratio of two hypotheses in one look."""


@dataclass(frozen=True, slots=True, eq=False)
class HandTorque:
    """The torque of hands about the suspension, over the weight, in body axes."""

    lever_m: NDArray[np.float64]
    """(3,) T / W"""
    covariance_m2: NDArray[np.float64]
    """(3, 3)"""


@dataclass(frozen=True, slots=True, eq=False)
class Hanging:
    """How the structure of one frame hangs without hands, in body axes."""

    up: NDArray[np.float64]
    """(3,) against gravity."""
    axes: NDArray[np.float64]
    """(axes, 3) about which it swings."""
    lever_m: NDArray[np.float64]
    """(3,) d, from the suspension to the centre of mass."""
    arm_m: NDArray[np.float64]
    """(nodes, 3) from the suspension to each node."""
    weight_n: NDArray[np.float64]
    """(nodes,)"""

    @property
    def tilt_by_torque(self) -> NDArray[np.float64]:
        """(axes, axes) -H^-1, the tilt about the axes by a torque over the weight, in rad per m."""
        by_tilt = -self.axes @ cross_matrix(self.lever_m) @ cross_matrix(self.up) @ self.axes.T
        left, restoring, right = np.linalg.svd(by_tilt)
        size_m = float(np.linalg.norm(self.arm_m, axis=1).max())
        lever_m = max(float(np.linalg.norm(self.lever_m)), LEAST_LEVER * size_m)
        restoring = np.maximum(restoring, LEAST_RESTORING * lever_m)
        return np.asarray(-(right.T / restoring) @ left.T)

    def forces_n(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (3 nodes,) F without a hand, and (nodes, 3 nodes, 3) dF / df of a hand at each node."""
        nodes = len(self.arm_m)
        by_tilt = (self.weight_n[:, None, None] * (-cross_matrix(self.up) @ self.axes.T)).reshape(3 * nodes, -1)
        by_force = by_tilt @ self.tilt_by_torque @ self.axes @ cross_matrix(self.arm_m) / self.weight_n.sum()
        by_force += np.eye(3 * nodes).reshape(3 * nodes, nodes, 3).swapaxes(0, 1)
        return -np.outer(self.weight_n, self.up).ravel(), by_force


class Hands:
    """Follows at which node a hand is, and how strong it is, look by look."""

    def __init__(self, free_nodes: NDArray[np.int64], settings: DoubtSettings) -> None:
        self._nodes = np.tile(free_nodes, len(STRENGTHS))
        self._load_n = settings.load_n * np.repeat(STRENGTHS, len(free_nodes))
        others = len(free_nodes) - 1
        share = len(free_nodes) * settings.loaded_share * (1 - settings.loaded_share) ** others
        share /= share + (1 - settings.loaded_share) ** (others + 1)
        prior = np.append(np.full(len(self._nodes), share / len(self._nodes)), 1 - share)
        self._regimes = Regimes(prior, HOLD_S)
        self._regimes.probability = np.append(np.zeros(len(self._nodes)), 1.0)

    def look(self, balances: list[Balance], hanging: Hanging, step_s: float) -> HandTorque:
        """Return the torque of hands in one more frame.

        Args:
            balances: of the frame, one for each standard deviation of a balance without load, as probable as each
                other.
            hanging: how the structure hangs.
            step_s: time since the look before.
        """
        weight_n, by_force = hanging.forces_n()
        B = self._load_n[:, None, None] * by_force[self._nodes]
        found = [_force_of_hand(balance, weight_n, B) for balance in balances]
        log_l = np.array([log_l for log_l, _, _ in found])
        evidence = logsumexp(log_l, axis=0)
        ratio = np.maximum(evidence - evidence.max(), -MOST_LOG_RATIO)
        self._regimes.predict(step_s)
        self._regimes.update(min(step_s / ALIKE_S, 1.0) * ratio)
        p = (self._regimes.probability * np.exp(log_l - evidence))[:, :-1]
        arm = cross_matrix(hanging.arm_m[self._nodes]) * (self._load_n / hanging.weight_n.sum())[:, None, None]
        lever = np.einsum("kij,qkj->qki", arm, np.array([z for _, z, _ in found]))
        second = np.einsum("kij,qkjl,kml->qkim", arm, np.array([spread for _, _, spread in found]), arm)
        second += lever[..., :, None] * lever[..., None, :]
        expected = np.einsum("qk,qki->i", p, lever)
        return HandTorque(expected, np.einsum("qk,qkij->ij", p, second) - np.outer(expected, expected))


def _force_of_hand(
    balance: Balance, F: NDArray[np.float64], B: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return (hands + 1,) the log evidence of each hand, and last of none, and (hands, 3) f / L with its covariance.

    Args:
        balance: of the frame.
        F: (3 nodes,) the outer forces without a hand.
        B: (hands, 3 nodes, 3) L dF / df.
    """
    e = balance.gradient + balance.information @ F
    without = balance.log_density - 0.5 * F @ (e + balance.gradient)
    spread = np.linalg.inv(np.eye(3) + np.swapaxes(B, 1, 2) @ balance.information @ B)
    g = -np.einsum("kni,n->ki", B, e)
    force = np.einsum("kij,kj->ki", spread, g)
    gain: NDArray[np.float64] = 0.5 * np.sum(g * force, axis=1) + 0.5 * np.linalg.slogdet(spread)[1]
    return np.append(without + gain, without), np.asarray(force), np.asarray(spread)


class Swing:
    """Follows the swing that hands leave, as that of a pendulum whose swing dies out by exp(-t / tau)."""

    def __init__(self, frequency_rad_per_s: float, swing_s: float) -> None:
        self._decay_per_s = 1 / swing_s
        self._frequency = float(np.sqrt(max(frequency_rad_per_s**2 - self._decay_per_s**2, 1e-6)))
        self._tilt = np.zeros(3)
        self._rate = np.zeros(3)
        self.seen_rad = 0.0
        """Amplitude to which the measured rates have taken it, which dies out, too."""

    def observe(self, at_rest_rad: NDArray[np.float64], step_s: float, seen_rad_per_s: float = 0.0) -> float:
        """Return the standard deviation of the tilt about that at which the structure comes to rest, in rad.

        Args:
            at_rest_rad: (3,) rotation vector of this tilt, by the torque of hands.
            step_s: time since the frame before.
            seen_rad_per_s: rate that inertial sensors measure, which takes it at least so far.
        """
        w, decay = self._frequency, self._decay_per_s
        away, sine, cosine = self._tilt - at_rest_rad, np.sin(w * step_s), np.cos(w * step_s)
        slope = (self._rate + decay * away) / w
        fade = np.exp(-decay * step_s)
        after = fade * (away * cosine + slope * sine)
        self._rate = fade * w * (slope * cosine - away * sine) - decay * after
        self._tilt = at_rest_rad + after
        self.seen_rad = max(fade * self.seen_rad, seen_rad_per_s / w)
        return float(np.sqrt(0.5 * (np.sum(after**2) + np.sum(self._rate**2) / w**2 + self.seen_rad**2)))
