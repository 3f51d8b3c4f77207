"""Structures from MuJoCo models: what moves as one is a rod or a rigid body, and spatial tendons are tendons.

Nodes are the sites at which tendons end, the places of ball joints, and of connect constraints; what is fixed to the
world is an anchor. A part with two nodes is a rod, one with more a rigid body, one with one node a knot. A part whose
sites lie in two narrow groups is a rod with hubs at its ends: its nodes are the middles of the groups. Tendons become
longer or shorter by that, and so do their natural lengths, so that they pull as in the model where it starts.

Springs between the same nodes are one tendon, with the sum of their stiffnesses k and the natural length at which
their forces cancel, L0 = sum(k L) / sum(k). What they push below it, p k, is what a bent strip pushes back.
"""

import re
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.structure_description import FLAT
from ...models.values.errors import InputError
from ...models.values.units import OTHER_UNIT
from .mujoco_model import MujocoModel, read_model
from .mujoco_springs import Spring, springs_of

SAME_M = 1e-5
"""Distance below which two points are one node."""
HUB_SHARE = 0.1
"""Largest radius of a hub, as a share of the length of its rod."""


def mjcf_tables(path: Path) -> dict[str, Any]:
    """Return the tables `structure`, `body` and `mechanics` of trial.toml that a MuJoCo model tells.

    Raises:
        InputError: for a model that MuJoCo cannot read or warns of, or that is no structure of rods, rigid bodies and
            tendons.
    """
    return _Model(read_model(path)).tables()


@dataclass(slots=True, eq=False)
class _Node:
    position_m: NDArray[np.float64]
    parts: set[int]
    """The bodies to which it belongs, each the first of all that are fixed to one another; 0 is the world."""
    name: str
    hub_radius_m: float = 0.0
    """Largest distance from it at which a tendon ends."""


@dataclass(slots=True, eq=False)
class _Tendon:
    stiffness: float
    natural_m: float
    pushes: float


@dataclass(slots=True, eq=False)
class _Model:
    """One model, read part by part."""

    of: MujocoModel
    nodes: list[_Node] = field(default_factory=list)
    ends: dict[int, _Node] = field(default_factory=dict)
    """The node of each site at which a tendon ends."""

    def tables(self) -> dict[str, Any]:
        self._add_ties()
        self._add_joints()
        springs = springs_of(self.of)
        self._add_ends(springs)
        for part in self._parts():
            self._put_hubs(part)
        self.nodes.sort(key=lambda node: _natural_order(node.name))
        position_m = [node.position_m for node in self.nodes]
        rods, rod_kg, bodies = [], [], []
        knot_kg = np.zeros(len(self.nodes))
        for part in self._parts():
            nodes = self._nodes_of(part)
            mass_kg = float(np.sum(self.of.model.body_mass[self.of.model.body_weldid == part]))
            if len(nodes) == 1:
                knot_kg[nodes] += mass_kg
            elif len(nodes) == 2:
                rods.append(nodes)
                rod_kg.append(mass_kg)
            else:
                position_m += _off_plane(np.array([position_m[node] for node in nodes]))
                nodes += range(len(knot_kg), len(position_m))
                knot_kg = np.append(knot_kg, np.zeros(len(position_m) - len(knot_kg)))
                bodies.append({"nodes": nodes, "mass_kg": mass_kg})
        if not rods and not bodies:
            raise InputError(f"{self.of.path}: expected bodies with two sites or more that tendons join, got none")
        tendons = self._tendons(springs)
        x = np.array(position_m)
        anchors = [index for index, node in enumerate(self.nodes) if 0 in node.parts]
        hub_radius_m = max(node.hub_radius_m for node in self.nodes)
        return {
            "structure": {
                "rods": rods,
                "tendons": [list(pair) for pair in tendons],
                "rod_length_m": [float(np.linalg.norm(x[a] - x[b])) for a, b in rods],
                "natural_length_m": [tendon.natural_m for tendon in tendons.values()],
                "anchors": anchors,
                "anchor_position_m": x[anchors].tolist(),
                "node_position_m": x.tolist(),
                **({"hub_radius_m": hub_radius_m} if hub_radius_m else {}),
            },
            **({"body": bodies} if bodies else {}),
            "mechanics": {
                "tendon_stiffness_n_per_m": [tendon.stiffness for tendon in tendons.values()],
                "rod_mass_kg": rod_kg,
                "push_back": [tendon.pushes / tendon.stiffness for tendon in tendons.values()],
                **({"knot_mass_kg": knot_kg.tolist()} if knot_kg.any() else {}),
            },
        }

    def _parts(self) -> list[int]:
        return sorted({part for node in self.nodes for part in node.parts} - {0})

    def _nodes_of(self, part: int) -> list[int]:
        return [index for index, node in enumerate(self.nodes) if part in node.parts]

    def _node(self, position_m: NDArray[np.float64], parts: set[int], name: str = "") -> _Node:
        """Return the node of some parts at a place, which is added if there is none."""
        for node in self.nodes:
            if node.parts & parts and np.linalg.norm(node.position_m - position_m) < SAME_M:
                node.parts |= parts
                node.name = node.name or name
                return node
        self.nodes.append(_Node(np.array(position_m), set(parts), name))
        return self.nodes[-1]

    def _add_ties(self) -> None:
        """Add the nodes at which constraints connect parts."""
        model, data, kinds = self.of.model, self.of.data, self.of.mujoco.mjtEq
        for number in range(model.neq):
            here = f"{self.of.path}: {self.of.name('equality', number)}"
            if model.eq_type[number] != kinds.mjEQ_CONNECT:
                kind = kinds(int(model.eq_type[number])).name.removeprefix("mjEQ_").lower()
                raise InputError(f"{here}: expected connect, the only constraint between rods that is read, got {kind}")
            one, other = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
            if model.eq_objtype[number] == self.of.mujoco.mjtObj.mjOBJ_SITE:
                apart_m = float(np.linalg.norm(data.site_xpos[one] - data.site_xpos[other]))
                if apart_m > SAME_M:
                    raise InputError(f"{here}: expected sites at one place at the start, got {apart_m:.3g} m apart")
                position_m = data.site_xpos[one]
                one, other = int(model.site_bodyid[one]), int(model.site_bodyid[other])
            else:
                turn = data.xmat[one].reshape(3, 3)
                position_m = data.xpos[one] + turn @ model.eq_data[number, :3]
            self._node(position_m, {int(model.body_weldid[one]), int(model.body_weldid[other])})

    def _add_joints(self) -> None:
        """Add the nodes about which parts turn; other joints than free, ball, or three slides are refused."""
        model, kinds = self.of.model, self.of.mujoco.mjtJoint
        for body in range(1, model.nbody):
            first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
            types = sorted(int(kind) for kind in model.jnt_type[first : first + count])
            free = [[int(kinds.mjJNT_FREE)], [int(kinds.mjJNT_SLIDE)] * 3]
            free.append(sorted([*free[1], int(kinds.mjJNT_BALL)]))
            parent = int(model.body_weldid[model.body_parentid[body]])
            if not types or (types in free and parent == 0):
                continue
            if types != [int(kinds.mjJNT_BALL)]:
                here = f"{self.of.path}: {self.of.name('body', body)}"
                raise InputError(f"{here}: expected to be free, or on a ball joint")
            self._node(self.of.data.xanchor[first], {int(model.body_weldid[body]), parent})

    def _add_ends(self, springs: list[Spring]) -> None:
        """Add the nodes at which tendons end."""
        model, data = self.of.model, self.of.data
        for site in (site for spring in springs for site in spring.sites):
            name = self.of.own_name("site", site) or f"site{site}"
            part = int(model.body_weldid[model.site_bodyid[site]])
            self.ends[site] = self._node(data.site_xpos[site], {part}, name)

    def _put_hubs(self, part: int) -> None:
        """Replace the nodes of a part by the middles of two groups, if it shares none, and each group is narrow."""
        nodes = [self.nodes[index] for index in self._nodes_of(part)]
        if len(nodes) < 3 or any(node.parts != {part} for node in nodes):
            return
        position_m = np.array([node.position_m for node in nodes])
        is_far = _is_at_far_end(position_m)
        middle_m = np.array([position_m[~is_far].mean(axis=0), position_m[is_far].mean(axis=0)])
        radius_m = float(np.linalg.norm(position_m - middle_m[is_far.astype(int)], axis=1).max())
        if radius_m > HUB_SHARE * np.linalg.norm(middle_m[1] - middle_m[0]):
            return
        for end, place_m in zip((~is_far, is_far), middle_m, strict=True):
            group = [node for node, at_end in zip(nodes, end, strict=True) if at_end]
            hub = _Node(place_m, {part}, min((node.name for node in group), key=_natural_order), radius_m)
            self.nodes = [node for node in self.nodes if node not in group] + [hub]
            self.ends |= {site: hub for site, node in self.ends.items() if node in group}

    def _tendons(self, springs: list[Spring]) -> dict[tuple[int, int], _Tendon]:
        """Return the tendons by their nodes, in the order of the springs that pull."""
        number = {id(node): index for index, node in enumerate(self.nodes)}
        joined: dict[frozenset[int], list[Spring]] = defaultdict(list)
        order: dict[tuple[int, int], frozenset[int]] = {}
        for spring in springs:
            one, other = (self.ends[site] for site in spring.sites)
            if one.parts & other.parts - {0}:
                raise InputError(f"{self.of.path}: {spring.name}: expected to join two bodies, got two sites of one")
            pair = frozenset((number[id(one)], number[id(other)]))
            if spring.pulls and not any(before.pulls for before in joined[pair]):
                order[number[id(one)], number[id(other)]] = pair
            joined[pair].append(spring)
        pulled = set(order.values())
        for pair in [pair for pair in joined if pair not in pulled][:1]:
            here = f"{self.of.path}: {joined[pair][0].name}"
            raise InputError(f"{here}: expected a spring that pulls, got one that only pushes")
        least_m = self._largest_part_m() / OTHER_UNIT
        return {nodes: self._tendon(joined[pair], least_m) for nodes, pair in order.items()}

    def _tendon(self, springs: list[Spring], least_m: float) -> _Tendon:
        """Return the one tendon that springs between the same nodes are, for whose length see `_check_length`."""
        pulling = [spring for spring in springs if spring.pulls]
        natural_m = {id(spring): spring.natural_m + self._farther_m(spring) for spring in springs}
        first_m = natural_m[id(pulling[0])]
        stiffness = sum(spring.stiffness_n_per_m for spring in pulling)
        off_n = sum(spring.stiffness_n_per_m * (natural_m[id(spring)] - first_m) for spring in pulling)
        tendon = _Tendon(stiffness, first_m + off_n / stiffness, 0.0)
        linear = all(spring.pushes for spring in pulling)  # then their sum is one spring at every length
        for spring in springs:
            here = f"{self.of.path}: {spring.name}"
            is_alike = abs(natural_m[id(spring)] - tendon.natural_m) <= SAME_M
            if spring.pulls and not (is_alike or linear or spring.natural_m <= self._apart_m(spring)):
                raise InputError(f"{here}: another tendon joins the same nodes, and this one is slack: expected one")
            if not spring.pulls and not is_alike:
                raise InputError(
                    f"{here}: expected to push below the length {tendon.natural_m:g} m from which it pulls, or not at "
                    f"all, got {natural_m[id(spring)]:g} m"
                )
            tendon.pushes += spring.stiffness_n_per_m if spring.pushes else 0.0
        self._check_length(pulling[0].name, tendon.natural_m - self._farther_m(pulling[0]), least_m)
        return tendon

    def _check_length(self, name: str, natural_m: float, least_m: float) -> None:
        """Raise InputError for a natural length so short that the tendon is a joint, or that nothing tells it."""
        if natural_m < least_m:
            raise InputError(
                f"{self.of.path}: {name}: expected a natural length of {least_m:.3g} m or more, a hundredth of the "
                f"largest body, got {natural_m:.3g} m: give its actuator a ctrlrange, or name a joint by a connect "
                "constraint"
            )

    def _largest_part_m(self) -> float:
        """Return the diagonal of the box around the nodes of the largest part."""
        boxes_m = [np.ptp([self.nodes[n].position_m for n in self._nodes_of(p)], axis=0) for p in self._parts()]
        return float(np.linalg.norm(boxes_m, axis=1).max())

    def _apart_m(self, spring: Spring) -> float:
        """Return the distance between the sites of a spring."""
        one_m, other_m = (self.of.data.site_xpos[site] for site in spring.sites)
        return float(np.linalg.norm(one_m - other_m))

    def _farther_m(self, spring: Spring) -> float:
        """Return by how much the nodes of a spring are farther apart than its sites, which may be on hubs."""
        one, other = (self.ends[site] for site in spring.sites)
        if one.hub_radius_m == other.hub_radius_m == 0:
            return 0.0
        return float(np.linalg.norm(one.position_m - other.position_m)) - self._apart_m(spring)


def _is_at_far_end(position_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (nodes,) which are nearer to the second than to the first of the two that are farthest apart."""
    apart_m = np.linalg.norm(position_m[:, None] - position_m, axis=2)
    first, second = np.unravel_index(int(apart_m.argmax()), apart_m.shape)
    return np.asarray(apart_m[second] < apart_m[first])


def _off_plane(position_m: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return a node off the plane of four or more that lie in one, so that their distances keep them; else nothing."""
    middle_m = position_m.mean(axis=0)
    _, extent_m, axes = np.linalg.svd(position_m - middle_m)
    if len(position_m) < 4 or extent_m[2] >= FLAT * extent_m[0]:
        return []
    return [middle_m + 0.5 * np.linalg.norm(position_m - middle_m, axis=1).max() * axes[2]]


def _natural_order(name: str) -> tuple[bool, list[tuple[str, int]]]:
    """Return a key that sorts n2 before n10, and nameless nodes last."""
    return not name, [(text, int(digits or 0)) for text, digits in re.findall(r"(\D*)(\d*)", name)]
