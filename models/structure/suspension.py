"""The suspension of a structure that hangs from one anchor, or swings about the line of two.

A structure of weight W, whose centre of mass is at d from the anchors, is at rest where the torque of the weight, and
that of hands T, is zero about every axis e about which it may swing:

    e . (d x (-z) + T / W) = 0

About one anchor e is any level direction, and the turn about the vertical is free; about two e is along their line.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..values.rotations import rotation, shortest_rotation
from .floor import UP
from .structure import Structure


@dataclass(frozen=True, slots=True, eq=False)
class Suspension:
    """Where a structure hangs, and about which axes it may swing."""

    pivot_m: NDArray[np.float64]
    """(3,) the anchor, or the middle of two."""
    axes: NDArray[np.float64]
    """(axes, 3) unit vectors in the world about which it swings: two that are level, or one along the line of two
    anchors."""
    mass_share: NDArray[np.float64]
    """(nodes,) share of each node in the mass of the structure."""

    @classmethod
    def of(cls, structure: Structure, node_mass_kg: NDArray[np.float64] | None = None) -> "Suspension":
        """Return the suspension of a structure with one or two anchors.

        Args:
            structure: with these anchors.
            node_mass_kg: (nodes,) mass at each node; if None, or without any mass, all rods are equally heavy.
        """
        anchor_m = structure.anchor_position_m
        axes = np.eye(3)[:2]
        if len(anchor_m) == 2:
            along = anchor_m[1] - anchor_m[0]
            axes = along[None] / np.linalg.norm(along)
        mass = np.zeros(0) if node_mass_kg is None else node_mass_kg
        if not mass.any():
            mass = np.bincount(structure.rods.ravel(), minlength=structure.node_count).astype(np.float64)
        return cls(anchor_m.mean(axis=0), axes, mass / mass.sum())

    @property
    def is_ball(self) -> bool:
        """Whether it is one anchor, about which the structure turns in any way."""
        return len(self.axes) > 1

    def lever_m(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (3,) d, from the pivot to the centre of mass, at (nodes, 3) positions."""
        return np.asarray(self.mass_share @ node_position_m - self.pivot_m)

    def torque_m(self, lever_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (axes,) the torque of the weight about each axis, over the weight."""
        return np.asarray(self.axes @ np.cross(lever_m, -UP))

    def hanging_m(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, 3) the same shape, turned about the suspension so that its centre of mass is lowest."""
        turn = self.turn_down(self.lever_m(node_position_m))
        return np.asarray(self.pivot_m + (node_position_m - self.pivot_m) @ turn.T)

    def askew_rad(self, node_position_m: NDArray[np.float64]) -> float:
        """Return the angle about the suspension by which the centre of mass is away from its lowest place."""
        return float(np.arccos(np.clip(0.5 * (np.trace(self.turn_down(self.lever_m(node_position_m))) - 1), -1, 1)))

    def turn_down(self, lever_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (3, 3) the rotation about the suspension that brings a centre of mass at d to its lowest place."""
        if self.is_ball:
            return shortest_rotation(lever_m / np.linalg.norm(lever_m), -UP)
        axis = self.axes[0]
        sine, cosine = axis @ np.cross(lever_m, -UP), np.cross(axis, lever_m) @ np.cross(axis, -UP)
        return rotation(axis * np.arctan2(sine, cosine))
