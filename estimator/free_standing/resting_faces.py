"""On which face of its hull a free-standing structure rests, or over which edge it tips, by the balance of forces.

Each face, and each edge, is a hypothesis h: the floor carries its nodes, gravity is against its normal, and hands may
load up to two nodes. With the shape marginalised, the balance r of the internal forces says of the outer forces F

    log p(F) = -1/2 F^T M F - v^T F + const,     M = A^T W A,  v = A^T W r,  W = (J C J^T + S)^-1

where A distributes F over the rows of the balance, J is its derivative by the shape, C the covariance of the shape as
lengths alone determine it, and S the variance of a balance without load. Under h the outer forces have the mean F_h and
the covariance B B^T of what the floor does at the nodes that stand, so that

    log L_h = -1/2 F_h^T M F_h - v^T F_h + 1/2 g^T G^-1 g - 1/2 log |G|,   G = 1 + B^T M B,  g = -B^T (v + M F_h)

and a hand is a further block of B: at one node, at two, or a squeeze of two nodes against each other.

The states of a hidden Markov model are the faces, and for each edge the tips over it from either face beside it. From a
face the structure comes to lean over one of its edges. From there it falls back, or lands on the other face; seldom it
rolls on, onto any face. It lands only while the lengths change, see `length_change`; a structure whose lengths stay the
same stands on the face on which it has stood. Errors of the lengths stay the same meanwhile: hysteresis follows the
strain, not time. The evidence of frames in which nothing changes therefore counts as that of one frame in two seconds.
Such errors do not explain that the evidence changes. In a slow push the lengths change little as the robot begins to
lean, and the forces are others from then on: a change in which the lengths stay the same counts in full, once, in
`SAME_MOVING_S`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.special import logsumexp

from ...models.balance.support import standing
from ...models.estimation import DoubtSettings
from ...models.pose.robot import FreeStandingRobot
from ...models.structure.rest_shape import RestShape
from ...models.values.time_series import low_pass_weight
from ..graph import GraphBuilder
from ..linear_frame import LinearFrame
from .contacts import Standing

LEANS_PER_S = 0.2
"""Rate at which a structure whose lengths do not change comes to lean over an edge, by a slow push."""
TIPS_PER_S = 3.0
"""The same while lengths change as if it tipped."""
LEAPS_PER_S = 0.1
"""Rate at which it rolls over several faces at once meanwhile, faster than they can be told, onto any."""
TIP_S = 0.3
"""Time for which it tips over an edge."""
UNSEEN = 1e-5
"""Probability of a leap onto any face in each step, even where nothing changes: nothing is impossible."""
SAME_S = 2.0
"""Time over which the evidence of successive frames is the same while lengths stay the same."""
SAME_MOVING_S = 0.4
"""The same while they change: the time that the sensors lag, and for which shapes are smoothed."""
MOST_EVIDENCE = 6.0
"""Limit of the log ratio of two hypotheses in one frame."""
POSSIBLE = 0.003
"""Probability above which another face or edge is counted in the uncertainty."""
HEIGHT_M = 0.01
"""Standard deviation of a known height under a hypothesis, by which the floor is not quite level."""
LESS_QUIET = (10 / 3, 10.0)
"""Other standard deviations of the balance at a node without load, each as probable: sensors may be worse than told."""


@dataclass(frozen=True, slots=True, eq=False)
class Balance:
    """What the balance of internal forces in one frame says of the outer forces at the nodes."""

    information: NDArray[np.float64]
    """(3 nodes, 3 nodes) M"""
    gradient: NDArray[np.float64]
    """(3 nodes,) v"""
    log_density: float
    """log p at F = 0, up to a constant."""


def balances_at(
    node_position_m: NDArray[np.float64], frame: LinearFrame, builder: GraphBuilder, quiet_n: float
) -> list[Balance]:
    """Return the balance of one frame as told, and for each of `LESS_QUIET`, all as probable as each other.

    Args:
        node_position_m: (nodes, 3) the shape.
        frame: its factors, linearised at it.
        builder: of the graph, with the balance of forces, and the variance that unknown mechanics add.
        quiet_n: standard deviation of the balance at a node without load.
    """
    assert builder.statics is not None, "faces and hands need the balance of forces"
    sigma_n = quiet_n * np.array([1.0, *LESS_QUIET])
    variances_n2 = builder.internal_variance_n2 + sigma_n[:, None] ** 2
    outer_jacobian = builder.statics.outer_force_jacobian(node_position_m)  # A
    held, gradient = frame.without_forces()
    by_shape = frame.force_jacobian
    solved = np.linalg.solve(held, np.column_stack([by_shape.T, gradient]))
    r = frame.force_n - by_shape @ solved[:, -1] - outer_jacobian @ builder.statics.outer_force_n.ravel()
    of_shape = by_shape @ solved[:, :-1]
    return [_balance(of_shape + np.diag(variance_n2), outer_jacobian, r) for variance_n2 in variances_n2]


def _balance(covariance: NDArray[np.float64], outer_jacobian: NDArray[np.float64], r: NDArray[np.float64]) -> Balance:
    """Return the balance of (rows,) residuals r with the (rows, rows) covariance W^-1."""
    weighted = np.linalg.solve(covariance, np.column_stack([outer_jacobian, r]))
    log_density = -0.5 * float(r @ weighted[:, -1]) - 0.5 * float(np.linalg.slogdet(covariance)[1])
    return Balance(outer_jacobian.T @ weighted[:, :-1], outer_jacobian.T @ weighted[:, -1], log_density)


class RestingFaces:
    """Follows the face or edge on which the structure stands, frame by frame."""

    def __init__(
        self,
        node_mass_kg: NDArray[np.float64],
        rest_position_m: NDArray[np.float64],
        standing_nodes: NDArray[np.bool_],
        settings: DoubtSettings,
    ) -> None:
        self._node_mass_kg = node_mass_kg
        self._settings = settings
        hull = ConvexHull(rest_position_m)
        faces = [tuple(sorted(face)) for face in hull.simplices.tolist()]
        edges = sorted({pair for a, b, c in faces for pair in ((a, b), (a, c), (b, c))})
        self._faces = np.array(faces)
        self._outward = np.sign(np.einsum("fi,fi->f", hull.equations[:, :3], _normals(rest_position_m, self._faces)))
        self._beside = np.array([[f for f, face in enumerate(faces) if set(edge) <= set(face)] for edge in edges])
        self._carried = np.zeros((len(faces) + len(edges), len(node_mass_kg)))
        for row, nodes in enumerate([*faces, *edges]):
            self._carried[row, list(nodes)] = 1.0
        tips = [(len(faces) + e, *way) for e, (f, g) in enumerate(self._beside.tolist()) for way in ((f, g), (g, f))]
        edge, self._from, self._onto = np.array(tips).T
        self._hypothesis = np.concatenate([np.arange(len(faces)), edge])
        self.probability: NDArray[np.float64]
        """(states,) of the faces, and of the tips over each edge from either face"""
        self._usual: NDArray[np.float64] | None = None  # evidence of the last moment
        self.stand_on(standing_nodes)

    def up(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (faces + edges, 3) the direction against gravity under each hypothesis; on an edge, the middle."""
        of_faces = -self._outward[:, None] * _normals(node_position_m, self._faces)
        of_edges = of_faces[self._beside].sum(axis=1)
        up = np.concatenate([of_faces, of_edges])
        return np.asarray(up / np.linalg.norm(up, axis=1, keepdims=True))

    def update(
        self, log_evidence: NDArray[np.float64], of_heights: NDArray[np.float64], step_s: float, may_tip: float
    ) -> None:
        """Carry the probabilities over a time step, and multiply them by the evidence of one frame.

        Args:
            log_evidence: (faces + edges,) of the balance.
            of_heights: (faces + edges,) of known heights.
            step_s: the time step.
            may_tip: see `LengthChange.may_have_tipped`.
        """
        self.probability = self.probability @ self._transition(step_s, may_tip)
        ratio = np.maximum(log_evidence - log_evidence.max(), -MOST_EVIDENCE)
        of_heights = np.maximum(of_heights - of_heights.max(), -MOST_EVIDENCE)
        usual = ratio if self._usual is None else self._usual
        news = ratio - usual
        self._usual = usual + max(float(low_pass_weight(step_s, SAME_MOVING_S)), may_tip) * news
        still_s, moving_s = (1 - may_tip) * step_s, may_tip * step_s
        of_forces = min(still_s / SAME_S + moving_s / SAME_MOVING_S, 1.0) * ratio
        of_forces += min(still_s / SAME_MOVING_S, 1.0) * news
        likelihood = np.exp(of_forces + of_heights)[self._hypothesis]
        self.probability = self.probability * likelihood / (self.probability @ likelihood)

    def stand_on(self, nodes: NDArray[np.bool_]) -> None:
        """Take it as known which nodes stand."""
        likeness = self._carried @ np.where(nodes, 1.0, -0.5) - 0.1 * self._carried.sum(axis=1)
        self.probability = np.full(len(self._hypothesis), 1e-4)
        self.probability[self._hypothesis == np.argmax(likeness)] = 1.0
        self.probability /= self.probability.sum()

    @property
    def standing(self) -> Standing:
        """Which nodes stand: those of the most probable face or edge."""
        return self._standing(self.probability)

    @property
    def probability_with_leaning(self) -> float:
        """That of the most probable face, and of leaning over one of its edges, from where it falls back."""
        faces = len(self._faces)
        of_faces = self.probability[:faces]
        leaning = np.bincount(self._from, self.probability[faces:], minlength=faces)
        likeliest = int(np.argmax(of_faces))
        return float(of_faces[likeliest] + leaning[likeliest])

    def smoothed(self, step_s: float, filtered: NDArray[np.float64], may_tip: NDArray[np.float64]) -> list[Standing]:
        """Return which nodes stood, given all evidence.

        Args:
            step_s: the time step.
            filtered: (times, states) the probabilities, each after an update.
            may_tip: (times,) as in the prediction before each update.
        """
        smoothed = filtered.copy()
        for k in range(len(filtered) - 2, -1, -1):
            step = self._transition(step_s, may_tip[k + 1])
            smoothed[k] = filtered[k] * (step @ (smoothed[k + 1] / np.maximum(filtered[k] @ step, 1e-300)))
            smoothed[k] /= smoothed[k].sum()
        return [self._standing(p) for p in smoothed]

    def log_evidence_of_heights(
        self, node_position_m: NDArray[np.float64], pairs: NDArray[np.int64], height_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return (faces + edges,) the log evidence of pairs of nodes whose difference in height is known.

        Args:
            node_position_m: (nodes, 3) the shape.
            pairs: (pairs, 2) of nodes.
            height_m: (pairs,) the height of the second node above the first.
        """
        between_m = node_position_m[pairs[:, 1]] - node_position_m[pairs[:, 0]]
        return self._of_heights(self.up(node_position_m)[: len(self._faces)] @ between_m.T, height_m)

    def log_evidence_of_clearances(
        self, node_position_m: NDArray[np.float64], nodes: NDArray[np.int64], clearance_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return (faces + edges,) the log evidence of nodes whose height above a node that stands is known.

        Args:
            node_position_m: (nodes, 3) the shape.
            nodes: (known,) of them.
            clearance_m: (known,) see `Floor.clearance_m`.
        """
        above_m = node_position_m[nodes] - node_position_m[self._faces[:, :1]]
        up = self.up(node_position_m)[: len(self._faces)]
        return self._of_heights(np.einsum("fi,fki->fk", up, above_m), clearance_m)

    def _of_heights(self, expected_m: NDArray[np.float64], height_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (faces + edges,) the log evidence of (known,) heights, from (faces, known) those on each face.

        On an edge the structure may lean to either face by any angle.
        """
        leaning_m = expected_m[self._beside]
        least_m = np.concatenate([expected_m, leaning_m.min(axis=1)])
        most_m = np.concatenate([expected_m, leaning_m.max(axis=1)])
        outside_m = np.maximum(least_m - height_m, 0) + np.maximum(height_m - most_m, 0)
        return np.asarray(-0.5 * np.sum((outside_m / HEIGHT_M) ** 2, axis=1))

    def log_evidence_in_parts(
        self, balances: Sequence[Balance], node_position_m: NDArray[np.float64], parts: int
    ) -> Iterator[NDArray[np.float64]]:
        """Yield the log evidence of a frame for each face, and then each edge, in some parts that take equally long.

        Args:
            balances: alternatives of equal probability, see `balances_at`.
            node_position_m: (nodes, 3) the shape.
            parts: their number.
        """
        F, B = self._of_floor(node_position_m)
        for part in np.array_split(np.arange(len(F)), parts):
            yield np.asarray(logsumexp([self._log_evidence(one, F[part], B[part]) for one in balances], axis=0))

    def _of_floor(self, node_position_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (hypotheses, 3 nodes) F_h and (hypotheses, 3 nodes, 9) B of weight and floor."""
        support = standing(self._node_mass_kg, node_position_m, self.up(node_position_m), 0.0, self._carried)
        F = support.force_n.reshape(len(self._carried), -1)
        B = np.zeros((*F.shape, 9))
        rows, nodes = np.nonzero(self._carried)
        columns = (np.cumsum(self._carried, axis=1).astype(np.int64) - 1)[rows, nodes]
        root = np.linalg.cholesky(support.covariance_n2[rows, nodes] + 1e-9 * np.eye(3))
        here = np.arange(3)
        B[rows[:, None, None], 3 * nodes[:, None, None] + here[:, None], 3 * columns[:, None, None] + here] = root
        return F, B

    def _log_evidence(self, balance: Balance, F: NDArray[np.float64], B: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (hypotheses,) the log evidence of one balance."""
        M = balance.information
        e = balance.gradient + F @ M
        log_l = -0.5 * np.sum(F * (e + balance.gradient), axis=1)
        gain, e, M_after = _marginalised(B, np.broadcast_to(M, (len(B), *M.shape)), e)
        return np.asarray(balance.log_density + log_l + gain + self._of_hands(e, M_after))

    def _standing(self, of_states: NDArray[np.float64]) -> Standing:
        probability = np.bincount(self._hypothesis, of_states)
        likeliest = int(np.argmax(probability))
        others = [int(h) for h in np.flatnonzero(probability > POSSIBLE) if h != likeliest]
        return Standing(
            nodes=self._carried[likeliest] > 0,
            probability=probability @ self._carried,
            others=tuple((float(probability[h]), self._carried[h] > 0) for h in others),
        )

    def _of_hands(self, e: NDArray[np.float64], M: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (hypotheses,) the log of the sum over no hand, one hand, the best second hand, and squeezes."""
        settings = self._settings
        nodes = len(self._node_mass_kg)
        loaded, free = np.log(settings.loaded_share), np.log(1 - settings.loaded_share)
        hypotheses = np.arange(len(e))
        B = np.zeros((nodes, 3 * nodes, 3))
        for node in range(nodes):
            B[node, 3 * node : 3 * node + 3] = settings.load_n * np.eye(3)
        first = _gain_of_one(settings.load_n, M, e)
        squeezed = _gain_of_squeeze(settings.load_n, M, e)
        best = np.argmax(first, axis=1)
        gain, e, M = _marginalised(B[best], M, e)
        second = _gain_of_one(settings.load_n, M, e)
        second[hypotheses, best] = -np.inf
        terms = [
            np.full((len(e), 1), nodes * free),
            first + loaded + (nodes - 1) * free,
            gain[:, None] + second + 2 * loaded + (nodes - 2) * free,
            squeezed + 2 * loaded + (nodes - 2) * free,
        ]
        return np.asarray(logsumexp(np.concatenate(terms, axis=1), axis=1))

    def _transition(self, step_s: float, may_tip: float) -> NDArray[np.float64]:
        """Return (states, states) the probability of each state after a time step, from each before it."""
        faces, states = len(self._faces), len(self._hypothesis)
        tips = np.arange(faces, states)
        lean = 1 - np.exp(-step_s * (LEANS_PER_S + (TIPS_PER_S - LEANS_PER_S) * may_tip))
        fall = 1 - np.exp(-step_s / TIP_S)
        land = fall * may_tip
        step = np.diag(np.where(np.arange(states) < faces, 1 - lean, (1 - fall) * (1 - land)))
        step[self._from, tips] = lean / 3
        step[tips, self._from] = fall * (1 - land)
        step[tips, self._onto] = land
        leap = 1 - np.exp(-step_s * LEAPS_PER_S * may_tip) + UNSEEN
        step *= 1 - leap
        step[:, :faces] += leap / faces
        return step


def _normals(x: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return (faces, 3) unit normals of triangles."""
    a, b, c = (x[faces[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def _marginalised(
    B: NDArray[np.float64], M: NDArray[np.float64], e: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return (k,) log evidence gained by unknown forces B z, z ~ N(0, 1), and the (k, n) e and (k, n, n) M after it."""
    MB = M @ B
    G = np.swapaxes(B, 1, 2) @ MB
    G[:, np.arange(G.shape[1]), np.arange(G.shape[1])] += 1.0
    g = np.einsum("kni,kn->ki", B, e)
    solved = np.linalg.solve(G, np.concatenate([np.swapaxes(MB, 1, 2), g[:, :, None]], axis=2))
    gain = 0.5 * np.einsum("ki,ki->k", g, solved[:, :, -1]) - 0.5 * np.linalg.slogdet(G)[1]
    after = e - np.einsum("kni,ki->kn", MB, solved[:, :, -1])
    return gain, after, M - MB @ solved[:, :, :-1]


def _gain_of_one(load_n: float, M: NDArray[np.float64], e: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (k, nodes) log evidence gained by a load at each node alone."""
    nodes = e.shape[1] // 3
    blocks = np.einsum("kninj->knij", M.reshape(-1, nodes, 3, nodes, 3))
    return _gain(np.eye(3) + load_n**2 * blocks, load_n * e.reshape(-1, nodes, 3))


def _gain_of_squeeze(load_n: float, M: NDArray[np.float64], e: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (k, pairs) log evidence gained by a load at one node and its opposite at another alone."""
    nodes = e.shape[1] // 3
    a, b = np.triu_indices(nodes, 1)
    blocks = np.swapaxes(M.reshape(-1, nodes, 3, nodes, 3), 2, 3)
    of_one, of_both = blocks[:, np.arange(nodes), np.arange(nodes)], blocks[:, a, b]
    G = np.eye(3) + load_n**2 * (of_one[:, a] + of_one[:, b] - of_both - np.swapaxes(of_both, -1, -2))
    e = e.reshape(-1, nodes, 3)
    return _gain(G, load_n * (e[:, a] - e[:, b]))


def _gain(G: NDArray[np.float64], g: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (...,) 1/2 g^T G^-1 g - 1/2 log |G| for many (..., 3, 3) G and (..., 3) g, by G = L D L^T written out.

    G is I plus a covariance, so that no pivot is below 1 but by rounding.
    """
    d0 = np.maximum(G[..., 0, 0], 1.0)
    l10, l20 = G[..., 1, 0] / d0, G[..., 2, 0] / d0
    d1 = np.maximum(G[..., 1, 1] - l10 * G[..., 1, 0], 1.0)
    below = G[..., 2, 1] - l20 * G[..., 1, 0]
    l21 = below / d1
    d2 = np.maximum(G[..., 2, 2] - l20 * G[..., 2, 0] - l21 * below, 1.0)
    z0 = g[..., 0]
    z1 = g[..., 1] - l10 * z0
    z2 = g[..., 2] - l20 * z0 - l21 * z1
    return np.asarray(0.5 * (z0**2 / d0 + z1**2 / d1 + z2**2 / d2 - np.log(d0 * d1 * d2)))


def resting_faces(rest: RestShape, robot: FreeStandingRobot, settings: DoubtSettings) -> RestingFaces | None:
    """Return the filter of faces of a robot that begins at rest; None where forces are unknown."""
    if not rest.node_mass_kg.any():
        return None
    stands = robot.floor.carries_at_rest(rest.node_position_m)
    return RestingFaces(rest.node_mass_kg, rest.node_position_m, stands, settings)
