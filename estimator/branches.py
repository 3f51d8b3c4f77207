"""The other shape: most sets of lengths have two exact shapes, one on each side of det J = 0.

One Gaussian can describe only one of the two. Let m be the mechanism, which is the unit motion that changes the lengths
least, s_1 the smallest singular value of J, and u its left singular vector. Along m,

    u . (l(x + a m) - l(x)) = s_1 a + c a^2 / 2,     c = sum_e u_e (|m_ab|^2 - (m_ab . d_e)^2) / l_e

is zero again at a = -2 s_1 / c: there the search for the other shape starts. In most frames the equilibrium of forces
shows which of the two is the right one.
"""

from collections.abc import Iterator
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from ..factors.noise import WeightedLengths, weigh
from ..models.estimation import BranchSettings
from ..models.structure.lengths import length_curvature_per_m
from ..models.structure.rigidity import branch, free_length_jacobian
from ..models.structure.shape import OtherShape, Shape
from ..models.structure.structure import Structure
from .graph import FrameSearch, GraphBuilder
from .whole_trial.far_minima import far_minima, is_unlikely
from .whole_trial.trial_balance import TrialBalance
from .whole_trial.trial_factors import TrialFactors

ITERATION_S = 0.02
"""Time that an iteration of a search is given; of frames that are further apart each does several."""


class OtherBranch:
    """Searches at regular times, or when asked, for another shape that explains a frame about equally well.

    A search takes about as long as the estimates of two frames at 50 Hz. It is spread over the frames that follow, by
    the time between them, so that no frame waits for it. Only where the shape hardly explains its frame, another one is
    also searched for far away, at once: see `far_minima`.
    """

    def __init__(self, builder: GraphBuilder, settings: BranchSettings) -> None:
        self._builder = builder
        self._settings = settings
        self._began_s = -np.inf
        self._last_s = np.nan
        self._search: Iterator[None] | None = None
        self._other_shape: OtherShape | None = None

    def with_other(self, shape: Shape) -> Shape:
        """Return the shape beside the other shape that the latest search found, if it found one."""
        due = shape.t_s - self._began_s >= self._settings.look_every_s
        if self._search is None and due and self._builder.structure.is_square:
            self._began_s = shape.t_s
            self._search = self._iterations(shape.node_position_m, weigh(shape.lengths, self._builder.noise))
        step_s = shape.t_s - self._last_s if np.isfinite(self._last_s) else ITERATION_S
        self._last_s = shape.t_s
        iterations = max(round(step_s / ITERATION_S), 1)
        if self._search is not None and len(list(islice(self._search, iterations))) < iterations:
            self._search = None
        return shape.beside(self._other_shape)

    def with_other_at_once(self, shape: Shape, error: float) -> Shape:
        """Return the shape beside another shape that explains its frame about equally well, if there is one.

        One is searched for only where the shape hardly explains its frame, or no forces tell the two apart.

        Args:
            shape: of a single frame.
            error: of the frame's own factors at the shape.
        """
        structure = self._builder.structure
        self._other_shape = None
        if structure.is_square and (self._builder.statics is None or is_unlikely(structure, error)):
            for _ in self._iterations(shape.node_position_m, weigh(shape.lengths, self._builder.noise)):
                pass
        return shape.beside(self._other_shape)

    def _iterations(self, position_m: NDArray[np.float64], measured: WeightedLengths) -> Iterator[None]:
        """Search the other minimum of a frame's own factors, and keep it if it is not much less probable.

        Yields after each iteration.
        """
        structure = self._builder.structure
        balance = TrialBalance.of_newest(self._builder, 1)  # of this frame; motors wind on while it is searched
        first = self._builder.search(measured, position_m)
        yield from _iterated(first)
        second = self._builder.search(measured, across(structure, first.node_position_m))
        yield from _iterated(second)
        is_other = branch(structure, second.node_position_m) * branch(structure, position_m) <= 0
        others = [OtherShape(second.node_position_m, second.error - first.error)] if is_other else []
        if is_unlikely(structure, first.error):
            others.append(self._far_shape(first.node_position_m, TrialFactors(self._builder, [measured], balance)))
        best = min(others, key=lambda other: other.log_ratio, default=None)
        self._other_shape = best if best and best.log_ratio < self._settings.log_ratio else None

    def _far_shape(self, position_m: NDArray[np.float64], factors: TrialFactors) -> OtherShape:
        """Return the most probable minimum of a frame's own factors that is not the one at (nodes, 3) positions."""
        frame = np.zeros(1, dtype=np.int64)
        far_m, far_error = far_minima(self._builder.structure, factors, frame, position_m[None])
        return OtherShape(far_m[0], float(far_error[0] - factors.error(position_m[None], frame)[0]))


def _iterated(search: FrameSearch) -> Iterator[None]:
    """Do a search; yield after each iteration."""
    while not search.ended:
        search.iterate()
        yield


def across(structure: Structure, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., nodes, 3) the positions along the mechanism at which lengths are, to second order, the same again.

    Args:
        structure: with as many free members as free coordinates.
        node_position_m: (..., nodes, 3) shapes.
    """
    jacobian = free_length_jacobian(structure, node_position_m)
    left, singular_value, right = np.linalg.svd(jacobian)
    motion = np.zeros_like(node_position_m)
    motion[..., structure.free_nodes, :] = right[..., -1, :].reshape(*jacobian.shape[:-2], -1, 3)
    bent_per_m = length_curvature_per_m(node_position_m, structure.free_members, motion)
    curvature = (left[..., None, :, -1] @ bent_per_m[..., None])[..., 0, 0]
    limit_m = 2 * float(structure.rod_length_m.mean())
    farthest_m = np.full_like(curvature, limit_m)
    step_m = np.divide(-2 * singular_value[..., -1], curvature, out=farthest_m, where=curvature != 0)
    return np.asarray(node_position_m + np.clip(step_m, -limit_m, limit_m)[..., None, None] * motion)
