"""Structures from MuJoCo models: what moves as one is a rod or a rigid body, and spatial tendons are tendons.

Nodes are the sites at which tendons end, the places of ball joints, and of connect constraints; what is fixed to the
world is an anchor. A part with two nodes is a rod, one with more a rigid body, one with one node a knot. A spring that
pulls beyond the upper of its two lengths, with stiffness k, is a tendon of natural length L0; one that pushes below its
lower length p k is what a bent strip pushes back.
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
from ...models.values.extras import needs_extra

SAME_M = 1e-5
"""Distance below which two points are one node."""
NEVER_M = 100.0
"""Upper length of a spring beyond which it never pulls: longer than any laboratory."""


def mjcf_tables(path: Path) -> dict[str, Any]:
    """Return the tables `structure`, `body` and `mechanics` of trial.toml that a MuJoCo model tells.

    Raises:
        InputError: for a model that MuJoCo cannot read or warns of, or that is no structure of rods, rigid bodies and
            tendons.
    """
    with needs_extra("a MuJoCo model", "twin"):
        import mujoco
    warnings: list[str] = []
    mujoco.set_mju_user_warning(warnings.append)  # MuJoCo itself writes them to the terminal and into a file
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
    except ValueError as error:
        raise InputError(f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}") from error
    finally:
        mujoco.set_mju_user_warning(None)
    if warnings:
        raise InputError(f"{path}: MuJoCo warns of it: {' '.join(warnings[0].split())}")
    return _Model(path, mujoco, model, data).tables()


@dataclass(slots=True, eq=False)
class _Node:
    position_m: NDArray[np.float64]
    parts: set[int]
    """The bodies to which it belongs, each the first of all that are fixed to one another; 0 is the world."""
    name: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class _Spring:
    name: str
    ends: tuple[_Node, _Node]
    stiffness: float
    low_m: float
    high_m: float


@dataclass(slots=True, eq=False)
class _Tendon:
    stiffness: float
    natural_m: float
    pushes: float = 0.0


@dataclass(slots=True, eq=False)
class _Model:
    """One model, read part by part."""

    path: Path
    mujoco: Any
    model: Any
    data: Any
    nodes: list[_Node] = field(default_factory=list)

    def tables(self) -> dict[str, Any]:
        self._add_ties()
        self._add_joints()
        springs = self._springs()
        self.nodes.sort(key=lambda node: _natural_order(node.name))
        tendons = self._tendons(springs)
        position_m = [node.position_m for node in self.nodes]
        rods, rod_kg, bodies = [], [], []
        knot_kg = np.zeros(len(self.nodes))
        for part in sorted({part for node in self.nodes for part in node.parts} - {0}):
            nodes = [index for index, node in enumerate(self.nodes) if part in node.parts]
            mass_kg = float(np.sum(self.model.body_mass[self.model.body_weldid == part]))
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
            raise InputError(f"{self.path}: expected bodies with two sites or more that tendons join, got none")
        x = np.array(position_m)
        anchors = [index for index, node in enumerate(self.nodes) if 0 in node.parts]
        return {
            "structure": {
                "rods": rods,
                "tendons": [list(pair) for pair in tendons],
                "rod_length_m": [float(np.linalg.norm(x[a] - x[b])) for a, b in rods],
                "natural_length_m": [tendon.natural_m for tendon in tendons.values()],
                "anchors": anchors,
                "anchor_position_m": x[anchors].tolist(),
                "node_position_m": x.tolist(),
            },
            **({"body": bodies} if bodies else {}),
            "mechanics": {
                "tendon_stiffness_n_per_m": [tendon.stiffness for tendon in tendons.values()],
                "rod_mass_kg": rod_kg,
                "push_back": [tendon.pushes / tendon.stiffness for tendon in tendons.values()],
                **({"knot_mass_kg": knot_kg.tolist()} if knot_kg.any() else {}),
            },
        }

    def _node(self, position_m: NDArray[np.float64], parts: set[int], name: str = "") -> _Node:
        """Return the node of some parts at a place, which is added if there is none."""
        for node in self.nodes:
            if node.parts & parts and np.linalg.norm(node.position_m - position_m) < SAME_M:
                node.parts |= parts
                node.name = node.name or name
                return node
        self.nodes.append(_Node(np.array(position_m), set(parts), name))
        return self.nodes[-1]

    def _name(self, kind: str, number: int) -> str:
        name = self.mujoco.mj_id2name(self.model, getattr(self.mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), number)
        return f"{kind} '{name}'" if name else f"{kind} {number}"

    def _add_ties(self) -> None:
        """Add the nodes at which constraints connect parts."""
        model, kinds = self.model, self.mujoco.mjtEq
        for number in range(model.neq):
            here = f"{self.path}: {self._name('equality', number)}"
            if model.eq_type[number] != kinds.mjEQ_CONNECT:
                raise InputError(f"{here}: expected connect, the only constraint between rods that is read")
            one, other = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
            if model.eq_objtype[number] == self.mujoco.mjtObj.mjOBJ_SITE:
                apart_m = float(np.linalg.norm(self.data.site_xpos[one] - self.data.site_xpos[other]))
                if apart_m > SAME_M:
                    raise InputError(f"{here}: expected sites at one place at the start, got {apart_m:.3g} m apart")
                position_m = self.data.site_xpos[one]
                one, other = int(model.site_bodyid[one]), int(model.site_bodyid[other])
            else:
                turn = self.data.xmat[one].reshape(3, 3)
                position_m = self.data.xpos[one] + turn @ model.eq_data[number, :3]
            self._node(position_m, {int(model.body_weldid[one]), int(model.body_weldid[other])})

    def _add_joints(self) -> None:
        """Add the nodes about which parts turn; other joints than free, ball, or three slides are refused."""
        model, kinds = self.model, self.mujoco.mjtJoint
        for body in range(1, model.nbody):
            first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
            types = sorted(int(kind) for kind in model.jnt_type[first : first + count])
            free = [[int(kinds.mjJNT_FREE)], [int(kinds.mjJNT_SLIDE)] * 3]
            free.append(sorted([*free[1], int(kinds.mjJNT_BALL)]))
            parent = int(model.body_weldid[model.body_parentid[body]])
            if not types or (types in free and parent == 0):
                continue
            if types != [int(kinds.mjJNT_BALL)]:
                raise InputError(f"{self.path}: {self._name('body', body)}: expected to be free, or on a ball joint")
            self._node(self.data.xanchor[first], {int(model.body_weldid[body]), parent})

    def _springs(self) -> list[_Spring]:
        """Return each spatial tendon as MuJoCo's spring, and add the nodes at its ends."""
        model = self.model
        springs = []
        for number in range(model.ntendon):
            name = self._name("tendon", number)
            first, count = int(model.tendon_adr[number]), int(model.tendon_num[number])
            kinds = model.wrap_type[first : first + count].tolist()
            if kinds != [int(self.mujoco.mjtWrap.mjWRAP_SITE)] * 2:
                raise InputError(f"{self.path}: {name}: expected a spatial tendon from one site to another")
            ends = (self._end(int(model.wrap_objid[first])), self._end(int(model.wrap_objid[first + 1])))
            low_m, high_m = model.tendon_lengthspring[number].tolist()
            springs.append(_Spring(name, ends, float(model.tendon_stiffness[number]), low_m, high_m))
        if not springs:
            raise InputError(f"{self.path}: expected spatial tendons between sites, got none")
        return springs

    def _end(self, site: int) -> _Node:
        name = self.mujoco.mj_id2name(self.model, self.mujoco.mjtObj.mjOBJ_SITE, site) or f"site{site}"
        return self._node(self.data.site_xpos[site], {int(self.model.body_weldid[self.model.site_bodyid[site]])}, name)

    def _tendons(self, springs: list[_Spring]) -> dict[tuple[int, int], _Tendon]:
        """Return the tendons by their nodes, of which each may be a spring that pulls and one that pushes."""
        number = {id(node): index for index, node in enumerate(self.nodes)}
        pulling: dict[tuple[int, int], _Tendon] = {}
        pushing: dict[frozenset[int], list[_Spring]] = defaultdict(list)
        for spring in springs:
            a, b = (number[id(end)] for end in spring.ends)
            if spring.low_m > 0 and spring.stiffness > 0:
                pushing[frozenset((a, b))].append(spring)
            if spring.high_m >= NEVER_M:
                continue
            if spring.stiffness <= 0:
                raise InputError(f"{self.path}: {spring.name}: expected a stiffness above 0, got {spring.stiffness:g}")
            if (a, b) in pulling or (b, a) in pulling:
                raise InputError(f"{self.path}: {spring.name}: another tendon joins the same sites: expected one")
            pulling[a, b] = _Tendon(spring.stiffness, spring.high_m)
        for pair, tendon in pulling.items():
            for spring in pushing.pop(frozenset(pair), []):
                if abs(spring.low_m - tendon.natural_m) > SAME_M:
                    raise InputError(
                        f"{self.path}: {spring.name}: expected to push below the length {tendon.natural_m:g} m from "
                        f"which it pulls, or not at all, got {spring.low_m:g} m"
                    )
                tendon.pushes += spring.stiffness
        for spring, *_ in pushing.values():
            raise InputError(f"{self.path}: {spring.name}: expected a spring that pulls, got one that only pushes")
        return pulling


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
