"""The last check of a shape before anyone sees it: an impossible one is replaced, and says so."""

from dataclasses import replace

import numpy as np

from .external_loads import ExternalLoads
from .lengths import member_length_m
from .rest_shape import RestShape
from .shape import Shape, Status

ROUNDING_M2 = 1e-12
"""Variance below zero that is rounding: anchors have none."""
RIGID = 0.1
"""Share of its length by which no rod of a shape differs from what it is; estimates keep rods to a thousandth. Lengths
that jump by their own size to and fro bend rods by a third, which no other check notices."""


class PossibleShapes:
    """Replaces shapes that no structure can have by the rest shape, with nothing known of any node."""

    def __init__(self, rest: RestShape) -> None:
        self._rest = rest
        self._size_m = float(rest.structure.rod_length_m.sum())

    def check(self, shape: Shape) -> Shape:
        """Return the shape; with the status `failed` in its place the rest shape, its sigma the size of the structure.

        Loads and slips that follow from an impossible shape are not known either.

        A shape is impossible when a number of it is not finite, a rod is not rigid, a node is farther from the rest
        shape than all rods are long together while the base is anchored, or a node's covariance is not positive.
        """
        if self._is_possible(shape):
            return shape
        rest_m = self._rest.node_position_m
        unknown = self._size_m**2 * np.eye(rest_m.size)
        return replace(
            shape,
            node_position_m=rest_m.copy(),
            covariance_m2=unknown,
            status=Status.FAILED,
            loads=ExternalLoads.unknown(len(rest_m)) if shape.loads else None,
            other=None,
            doubt=None,
            slips=(),
        )

    def _is_possible(self, shape: Shape) -> bool:
        x, structure = shape.node_position_m, self._rest.structure
        if not (np.isfinite(x).all() and np.isfinite(shape.covariance_m2).all()):
            return False
        rod_m = member_length_m(x, structure.rods)
        if (np.abs(rod_m - structure.rod_length_m) > RIGID * structure.rod_length_m).any():
            return False
        if not structure.is_free_standing and np.abs(x - self._rest.node_position_m).max() > self._size_m:
            return False
        try:
            np.linalg.cholesky(shape.node_covariance_m2 + ROUNDING_M2 * np.eye(3))
        except np.linalg.LinAlgError:
            return False
        return True
