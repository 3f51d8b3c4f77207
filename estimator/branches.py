"""The other shape: most sets of lengths have two exact shapes, on either side of det J = 0, and one Gaussian hides one.

Along the mechanism m, the unit motion that lengths see least, with smallest singular value s_1 and its lengths u,

    u . (l(x + a m) - l(x)) = s_1 a + c a^2 / 2,     c = sum_e u_e (|m_ab|^2 - (m_ab . d_e)^2) / l_e

is zero again at a = -2 s_1 / c, where the other shape is looked for. Equilibrium tells the two apart, mostly.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..factors.noise import weigh
from ..models.estimation import BranchSettings
from ..models.structure.rigidity import branch, free_length_jacobian
from ..models.structure.shape import OtherShape, Shape, Status
from ..models.values.readings import TendonLengths
from .graph import GraphBuilder


class OtherBranch:
    """Looks, now and then, whether the other shape explains a frame as well."""

    def __init__(self, builder: GraphBuilder, settings: BranchSettings) -> None:
        self._builder = builder
        self._settings = settings
        self._looked_s = -np.inf
        self._found: OtherShape | None = None

    def with_other(self, shape: Shape) -> Shape:
        """Return the shape, with the other one if that explained the newest frame looked at about as well."""
        if self._builder.structure.is_square and shape.t_s - self._looked_s >= self._settings.look_every_s:
            self._looked_s = shape.t_s
            self._found = self._other(shape.node_position_m, shape.lengths)
        return replace(shape, status=Status.TWO_SHAPES, other=self._found) if self._found else shape

    def _other(self, position_m: NDArray[np.float64], lengths: TendonLengths) -> OtherShape | None:
        structure = self._builder.structure
        measured = weigh(lengths, self._builder.noise)
        here = self._builder.minimum(measured, position_m)
        there = self._builder.minimum(measured, self._across(here.node_position_m))
        if branch(structure, there.node_position_m) * branch(structure, position_m) > 0:
            return None
        log_ratio = there.error - here.error
        return OtherShape(there.node_position_m, log_ratio) if log_ratio < self._settings.log_ratio else None

    def _across(self, position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where, to second order along the mechanism, the lengths are the same again."""
        structure = self._builder.structure
        jacobian = free_length_jacobian(structure, position_m)
        left, singular_value, right = np.linalg.svd(jacobian)
        motion = np.zeros_like(position_m)
        motion[structure.free_nodes] = right[-1].reshape(-1, 3)
        a, b = structure.free_members.T
        difference = position_m[b] - position_m[a]
        relative = motion[b] - motion[a]
        length = np.linalg.norm(difference, axis=1)
        along = np.einsum("ek,ek->e", relative, difference) / length
        curvature = left[:, -1] @ ((np.sum(relative**2, axis=1) - along**2) / length)
        step_m = -2 * singular_value[-1] / curvature
        limit_m = 2 * float(structure.rod_length_m.mean())
        return np.asarray(position_m + np.clip(step_m, -limit_m, limit_m) * motion)
