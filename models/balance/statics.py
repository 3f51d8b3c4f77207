"""Static equilibrium: tendon tensions, gravity and loads balance at every node, except for the forces along its rods.

Tendon e = a-b with l = |x_a - x_b|, u = (x_a - x_b) / l has the tension T = kappa (l - L0), where kappa = k when the
tendon is stretched and p k when it is bent (p is small: a bent strip pushes back a little, a cable does not). The force
at the nodes is f = -B T u - m g with the mass m of a node and the incidence matrix B. A rod i-j along w takes any force
along itself, so that the residual at each free node is

    r_n = (I - w w^T) f_n                            (for a node on no rod r_n = f_n)

and along each floating rod, whose two ends are both free, s = w^T (f_i + f_j). Without load both are zero; a load F_n
makes them r_n = -(I - w w^T) F_n, s = -w^T (F_i + F_j). A load along a rod that has an anchor at one end does not
appear in the residual, because the anchor takes it.

Rods that share free nodes take more of the forces (`joined_rods`), and stiff cables have tensions that do not follow
from their lengths (`stiff_cables`).
"""

from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..structure.lengths import member_length_m
from ..structure.mechanics import Mechanics
from ..structure.structure import Structure
from .joined_rods import JoinedRods
from .stiff_cables import StiffCables, jacobian_without_cables, without_cables
from .support import Support, in_the_air

SURELY_SLACK = 4.0
"""Number of standard deviations by which a cable that is slack for certain is shorter than its natural length."""
LEAST_RANK = 0.1
"""Least number of independent rows of a node at which cables take all that a load could do."""
IDENTITY = np.eye(3)


class _Tendons(NamedTuple):
    """How all tendons pull at one shape or many."""

    unit: NDArray[np.float64]
    """(..., tendons, 3) u"""
    length_m: NDArray[np.float64]
    """(..., tendons) l"""
    stiffness_n_per_m: NDArray[np.float64]
    """(..., tendons) kappa"""
    tension_n: NDArray[np.float64]
    """(..., tendons) T"""


class _Rods(NamedTuple):
    """The directions w of rods, and their lengths ell, at one shape or many."""

    at_node: NDArray[np.float64]
    """(..., free nodes, 3) w to each free node from the other end of its rod; 0 for a node on no rod."""
    length_m: NDArray[np.float64]
    """(..., free nodes, 1) ell of these rods; 1 for a node on no rod."""
    floating: NDArray[np.float64]
    """(..., floating rods, 3) w of each rod without an anchor, from its first end to its second."""
    floating_length_m: NDArray[np.float64]
    """(..., floating rods, 1)"""


class Statics:
    """The balance of forces of one structure as residuals in newtons, with their derivatives.

    There are three rows for each free node in order, then one for each floating rod. All positions may have leading
    axes, and so may natural lengths and supports.
    """

    def __init__(self, structure: Structure, mechanics: Mechanics) -> None:
        self.structure = structure
        self.mechanics = mechanics
        count = structure.node_count
        self._a, self._b = structure.tendons.T
        tendons = np.arange(len(structure.tendons))
        self._incidence = np.zeros((count, len(tendons)))
        self._incidence[self._a, tendons] = 1.0
        self._incidence[self._b, tendons] = -1.0
        self._elastic = np.where(np.isin(tendons, mechanics.stiff_cables), 0.0, 1.0)
        self._stand_on(in_the_air(structure, mechanics.node_mass_kg(structure)))
        self.nodes = structure.free_nodes
        self.joined = JoinedRods(structure)
        single = structure.rods[~self.joined.is_joined]
        partner = np.arange(count)
        partner[single] = single[:, ::-1]
        self._partner = partner[self.nodes]
        self._on_no_rod = np.where(self._partner == self.nodes, 1.0, 0.0)[:, None]
        self.floating_rods = single[np.isin(single, self.nodes).all(axis=1)]
        self._rod_ends = np.searchsorted(self.nodes, self.floating_rods[:, 1])  # of these, the second ones
        self._rows = (3 * np.searchsorted(self.nodes, self.joined.nodes)[:, None] + np.arange(3)).ravel()
        self._take_ends()
        self.group = np.concatenate(
            [np.repeat(np.arange(len(self.nodes)), 3), len(self.nodes) + np.arange(len(self.floating_rods))]
        )
        """(rows,) the group of each row: the rows of one node get one common weight, and each rod has its own."""
        self.group_start = np.flatnonzero(np.diff(self.group, prepend=-1))
        """(groups,) the first row of each group."""
        self._cables = StiffCables(mechanics.stiff_cables, self.group, self.group_start)

    def _take_ends(self) -> None:
        """Number the ends of tendons at free nodes, in the order of these nodes."""
        self._end_node, self._end_tendon = np.nonzero(self._incidence[self.nodes])
        node = self.nodes[self._end_node]
        self._end_far = (self._a + self._b)[self._end_tendon] - node
        ends = np.arange(len(node))
        self._ends_at = np.zeros((len(self.nodes), len(ends)))
        self._ends_at[self._end_node, ends] = 1.0
        by_rod = np.zeros((len(self.floating_rods), self.structure.node_count, len(ends)))
        for rod, (i, j) in enumerate(self.floating_rods):
            sign = (node == j).astype(np.float64) - (node == i)  # at a free node w points to it, on a rod from i to j
            by_rod[rod, self._end_far, ends] += sign
            by_rod[rod, node, ends] -= sign
        self._ends_on_rods = by_rod.reshape(len(self.floating_rods) * self.structure.node_count, len(ends))

    def supported(self, support: Support) -> "Statics":
        """Return the same balance with another force of gravity and floor."""
        other = copy(self)
        other._stand_on(support)
        return other

    def wound(self, natural_length_m: NDArray[np.float64]) -> "Statics":
        """Return the same balance with other (tendons,) natural lengths, as motors change them."""
        other = copy(self)
        other.mechanics = replace(self.mechanics, natural_length_m=natural_length_m)
        return other

    def _stand_on(self, support: Support) -> None:
        self._support = support
        self._outer_n = support.force_n + self.mechanics.offset_n

    @property
    def outer_force_n(self) -> NDArray[np.float64]:
        """(nodes, 3) the force of gravity and floor."""
        return self._support.force_n

    def node_force_n(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., nodes, 3), the force f of tendons and gravity at each node."""
        tendons = self._tendons(node_position_m)
        return np.asarray(self._outer_n - self._incidence @ (tendons.tension_n[..., None] * tendons.unit))

    def residual_n(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., rows), the residuals r and s: the part of the forces that rods and anchors cannot balance."""
        rows = self._rows_n(node_position_m)
        if not len(self._cables.tendons):
            return rows
        return without_cables(rows[..., None], self._cable_pull(node_position_m, rows))[..., 0]

    def _rows_n(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., rows) the residuals without the tensions of stiff cables."""
        force = self.node_force_n(node_position_m)
        rods = self._rods(node_position_m)
        across = force[..., self.nodes, :]
        across = across - rods.at_node * np.sum(rods.at_node * across, axis=-1, keepdims=True)
        axial = np.sum(rods.floating * force[..., self.floating_rods, :].sum(axis=-2), axis=-1)
        return self._allowed(
            np.concatenate([across.reshape(*across.shape[:-2], -1), axial], axis=-1)[..., None], node_position_m
        )[..., 0]

    def _allowed(self, rows: NDArray[np.float64], node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., rows, n) the same rows, those of joined nodes without what the joined rods take."""
        if len(self._rows):
            rows[..., self._rows, :] = self.joined.allowed(node_position_m) @ rows[..., self._rows, :]
        return rows

    def _without_cables(self, rows: NDArray[np.float64], node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., rows, n) what is left of rows, whatever the unknown tensions of stiff cables are."""
        if not len(self._cables.tendons):
            return rows
        return without_cables(rows, self._cable_pull(node_position_m, self._rows_n(node_position_m)))

    def _cable_pull(self, node_position_m: NDArray[np.float64], rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., rows, stiff cables) B, the rows by a tension of 1 N; zero for cables that do not pull.

        Args:
            node_position_m: (..., nodes, 3)
            rows: (..., rows) the residuals without the tensions of stiff cables.
        """
        by_tension = self._by_tension(node_position_m)[..., self._cables.tendons]
        pulls = self._cables.pulls(rows, by_tension, self._may_be_taut(node_position_m))
        return by_tension * pulls[..., None, :]

    def cable_tension_n(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., stiff cables) the tensions with which forces balance best; zero for cables that are slack."""
        rows = self._rows_n(node_position_m)
        return self._cables.tension_n(rows, self._cable_pull(node_position_m, rows))

    def _may_be_taut(self, node_position_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (..., stiff cables) where a cable is not too short to be taut."""
        cables = self._cables.tendons
        length_m = member_length_m(node_position_m, self.structure.tendons[cables])
        short_m = self.mechanics.natural_length_m[..., cables] - length_m
        return np.asarray(short_m < SURELY_SLACK * self.mechanics.cable_sigma_m)

    @cached_property
    def rank_of_row(self) -> NDArray[np.float64]:
        """(rows,) the number of independent rows in the group of each row; less where cables pull, in general shape."""
        rank = np.concatenate([self.rows_per_node, np.ones(len(self.floating_rods))])[self.group]
        if len(self._cables.tendons):
            x = np.random.default_rng(0).normal(size=(self.structure.node_count, 3))
            rank -= self._cables.rank_taken(self._by_tension(x)[:, self._cables.tendons])
        return np.asarray(np.maximum(rank, LEAST_RANK))

    @property
    def rank(self) -> int:
        """The number of independent rows; stiff cables are taken as taut."""
        return round(float(self.rows_per_node.sum())) + len(self.floating_rods) - len(self._cables.tendons)

    @property
    def rows_per_node(self) -> NDArray[np.float64]:
        """(free nodes,) the number of independent rows of each node: two on a rod, less on joined rods, else three."""
        rows = 2 + self._on_no_rod[:, 0]
        rows[self._rows[::3] // 3] = self.joined.rows_per_node
        return np.asarray(rows)

    def node_residual_n(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, 3) forces at the nodes that have the residuals of `residual_n`; an axial one in equal halves.

        Args:
            node_position_m: (nodes, 3)
        """
        residual = self.residual_n(node_position_m)
        force = np.zeros((self.structure.node_count, 3))
        force[self.nodes] = residual[: 3 * len(self.nodes)].reshape(-1, 3)
        along = self._rods(node_position_m).floating
        force[self.floating_rods] += 0.5 * (residual[3 * len(self.nodes) :, None] * along)[:, None]
        return force

    def residual_and_jacobian(
        self, node_position_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals (..., rows) and their derivatives (..., rows, 3 nodes) by all coordinates.

        With P = I - w w^T, dw/dx_n = P / ell, and S_e = kappa u u^T + (T / l) (I - u u^T), so that at an end n of a
        tendon e = n-m df_n/dx_m = S_e and df_n/dx_n = -S_e:

            dr_n/dx = P df_n/dx - ((w . f_n) P + w r_n^T) / ell at n, + the same at the rod's other end
            ds/dx   = w^T (df_i/dx + df_j/dx) -+ (f_i + f_j)^T P / ell at i and j
        """
        r, jacobian = self._by_rods(node_position_m, self._outer_n, self._tendons(node_position_m))
        if len(self._cables.tendons):
            return self._by_cables(node_position_m, r, jacobian)
        return r, jacobian

    def _by_cables(
        self, x: NDArray[np.float64], r: NDArray[np.float64], jacobian: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what stiff cables leave of (..., rows) residuals r, and its derivative, from those of r."""
        pull = self._cable_pull(x, r)
        cables, lead = self._cables.tendons, x.shape[:-2]
        each = np.broadcast_to(x[..., None, :, :], (*lead, len(cables), *x.shape[-2:]))
        unit, length = self._directions(each)
        pulls = np.any(pull, axis=-2, keepdims=True).swapaxes(-1, -2)
        tension = pulls * np.eye(len(self._elastic))[cables]
        pulling = _Tendons(unit, length, np.zeros_like(length), tension)
        _, by_pull = self._by_rods(each, np.zeros(x.shape[-2:]), pulling)
        return jacobian_without_cables(r, jacobian, pull, by_pull)

    def _by_rods(
        self, x: NDArray[np.float64], outer_n: NDArray[np.float64], tendons: _Tendons
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals and their derivatives for given tensions, before unknown ones are taken out.

        Args:
            x: (..., nodes, 3) positions.
            outer_n: (..., nodes, 3) all forces but those of tendons.
            tendons: their tensions and stiffnesses.
        """
        lead, nodes, rods = x.shape[:-2], self.nodes, self.floating_rods
        unit, length, stiffness, tension = tendons
        force = outer_n - self._incidence @ (tension[..., None] * unit)
        w, ell, w_floating, ell_floating = self._rods(x)
        f = force[..., nodes, :]
        wf = np.sum(w * f, axis=-1, keepdims=True)
        r = f - w * wf
        turn = (wf[..., None] * (IDENTITY - _outer(w, w)) + _outer(w, r)) / ell[..., None]
        f_rod = force[..., rods, :].sum(axis=-2)
        s = np.sum(w_floating * f_rod, axis=-1, keepdims=True)
        turn_rod = (f_rod - w_floating * s) / ell_floating

        jacobian = np.zeros((*lead, len(self.group), x.shape[-2] * 3))
        across = jacobian[..., : 3 * len(nodes), :].reshape(*lead, len(nodes), 3, -1, 3).swapaxes(-3, -2)
        axial = jacobian[..., 3 * len(nodes) :, :].reshape(*lead, len(rods), x.shape[-2], 3)
        at_ends, along_ends = self._by_far_ends(w, unit, tension / length, stiffness)
        index = np.arange(len(nodes))
        across[..., self._end_node, self._end_far, :, :] = at_ends
        across[..., index, nodes, :, :] = -(self._ends_at @ at_ends.reshape(*lead, -1, 9)).reshape(turn.shape) - turn
        across[..., index, self._partner, :, :] += turn
        axial += (self._ends_on_rods @ along_ends).reshape(axial.shape)
        index = np.arange(len(rods))
        axial[..., index, rods[:, 1], :] += turn_rod
        axial[..., index, rods[:, 0], :] -= turn_rod

        rows = np.concatenate([r.reshape(*lead, -1), s[..., 0]], axis=-1)
        if len(self._rows):
            by_position = self.joined.by_position(x, rows[..., self._rows], jacobian[..., self._rows, :])
            jacobian[..., self._rows, :] = by_position
        return self._allowed(rows[..., None], x)[..., 0], jacobian

    def _by_far_ends(
        self,
        w: NDArray[np.float64],
        unit: NDArray[np.float64],
        slope: NDArray[np.float64],
        stiffness: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (..., ends, 3, 3) P S_e and (..., ends, 3) w^T S_e, at each end of a tendon that is at a free node.

        Args:
            w: (..., free nodes, 3), see `_Rods`.
            unit: (..., tendons, 3) u_e.
            slope: (..., tendons) T / l.
            stiffness: (..., tendons) kappa.
        """
        S = slope[..., None, None] * IDENTITY + (stiffness - slope)[..., None, None] * _outer(unit, unit)
        S = S[..., self._end_tendon, :, :]
        w = w[..., self._end_node, :]
        along = np.einsum("...k,...kj->...j", w, S)
        return S - _outer(w, along), along

    def support_variance_n2(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., rows) the variance of the residuals by that of the support, with one value in each group."""
        covariance = self._support.covariance_n2
        rods = self._rods(node_position_m)
        w, along = rods.at_node, rods.floating
        at_node = covariance[..., self.nodes, :, :]
        across = np.trace(at_node, axis1=-2, axis2=-1) - np.einsum("...ni,...nij,...nj->...n", w, at_node, w)
        at_rod = covariance[..., self.floating_rods, :, :].sum(axis=-3)
        axial = np.einsum("...ri,...rij,...rj->...r", along, at_rod, along)
        if len(self._rows):
            allowed = self.joined.allowed(node_position_m)
            allowed = allowed.reshape(*allowed.shape[:-1], -1, 3)
            at_joined = covariance[..., self.joined.nodes, :, :]
            by_row = np.einsum("...rni,...nij,...rnj->...r", allowed, at_joined, allowed)
            across[..., self._rows[::3] // 3] = by_row.reshape(*by_row.shape[:-1], -1, 3).sum(axis=-1)
        across = across / np.maximum(self.rows_per_node, LEAST_RANK)
        return np.asarray(np.concatenate([across, axial], axis=-1)[..., self.group])

    def outer_force_jacobian(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (rows, 3 nodes), the derivatives of the residuals by forces at the nodes.

        Args:
            node_position_m: (nodes, 3)
        """
        rods = self._rods(node_position_m)
        w = rods.at_node
        jacobian = np.zeros((len(self.group), self.structure.node_count, 3))
        index = np.arange(len(self.nodes))
        across = jacobian[: 3 * len(self.nodes)].reshape(len(self.nodes), 3, -1, 3)
        across[index, :, self.nodes] = IDENTITY - w[:, :, None] * w[:, None, :]
        axial = 3 * len(self.nodes) + np.arange(len(self.floating_rods))
        for end in (0, 1):
            jacobian[axial, self.floating_rods[:, end]] = rods.floating
        rows = self._allowed(jacobian.reshape(len(jacobian), -1), node_position_m)
        return self._without_cables(rows, node_position_m)

    def mechanics_jacobian(self, node_position_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return the derivatives (..., rows, tendons) of the residuals by log k and by L0."""
        tendons = self._tendons(node_position_m)
        by_tension = self._without_cables(self._by_tension(node_position_m), node_position_m)
        return by_tension * tendons.tension_n[..., None, :], -by_tension * tendons.stiffness_n_per_m[..., None, :]

    def _by_tension(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., rows, tendons) the rows by a tension of 1 N, before unknown ones are taken out."""
        unit, _ = self._directions(node_position_m)
        pull = -self._incidence[:, :, None] * unit[..., None, :, :]  # (..., nodes, tendons, 3) per unit of tension
        rods = self._rods(node_position_m)
        across = pull[..., self.nodes, :, :]
        along = np.einsum("...nk,...nek->...ne", rods.at_node, across)
        across = across - along[..., None] * rods.at_node[..., None, :]
        across = np.swapaxes(across, -1, -2).reshape(*across.shape[:-3], -1, across.shape[-2])
        axial = np.einsum("...rk,...rek->...re", rods.floating, pull[..., self.floating_rods, :, :].sum(axis=-3))
        return self._allowed(np.concatenate([across, axial], axis=-2), node_position_m)

    def _tendons(self, x: NDArray[np.float64]) -> _Tendons:
        """Return direction, length, stiffness and tension of all tendons; the latter two are 0 of stiff cables."""
        unit, length = self._directions(x)
        extension = length - self.mechanics.natural_length_m
        k = self._elastic * self.mechanics.stiffness_n_per_m
        stiffness = np.where(extension > 0, k, self.mechanics.push_back * k)
        return _Tendons(unit, length, stiffness, stiffness * extension)

    def _directions(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return unit vectors u and lengths l of all tendons."""
        difference = x[..., self._a, :] - x[..., self._b, :]
        length = np.sqrt(np.einsum("...k,...k->...", difference, difference))
        return difference / length[..., None], length

    def _rods(self, x: NDArray[np.float64]) -> _Rods:
        """Return direction and length of the rod at each free node, and of each floating rod."""
        difference = x[..., self.nodes, :] - x[..., self._partner, :]  # zero for a node on no rod
        ell = np.sqrt(np.sum(difference * difference, axis=-1, keepdims=True)) + self._on_no_rod
        w = difference / ell
        return _Rods(w, ell, w[..., self._rod_ends, :], ell[..., self._rod_ends, :])


def _outer(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., 3, 3) a b^T."""
    return np.asarray(np.einsum("...i,...j->...ij", a, b))
