"""A structure as MuJoCo's model file (MJCF).

A tendon between nodes a and b, of length l, natural length L0, stiffness k and damping c, pulls with

    T = k (l - L0) + c dl/dt       l >= L0
    T = p k (l - L0) + c dl/dt     l <  L0: a bent strip pushes back a little, p << 1

A rod of mass m and length l is uniform and thin (inertia m l^2 / 12 about its middle), and drag acts on all of its
length alike: force -d v and moment -(d l^2 / 12) w about its middle. Rods and tendons pass through one another.

Mass beside the rods is at the nodes. A rigid body is as wide as its nodes; it and a node on no rod have the drag of a
rod that moves sideways. Where several rods or bodies have one node, the first one has its site `nK`, and the others a
site that is tied to it.
"""

from collections import Counter
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from ..structure.structure import Structure

FAR_M = 1e3
"""Longer than any tendon."""


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """All that the dynamics need to know of one structure; each tendon has its own constants."""

    structure: Structure
    """With the true natural lengths; its anchors are held, or lie on the ground."""
    rod_mass_kg: NDArray[np.float64] | float
    """(rods,) or one for all; those of the distances in rigid bodies are not used."""
    rod_radius_m: NDArray[np.float64] | float
    """(rods,) or one for all; of the rod, and of its round ends, which touch the ground."""
    rod_drag_n_s_per_m: float
    """d"""
    stiffness_n_per_m: NDArray[np.float64]
    """(tendons,) k"""
    damping_n_s_per_m: float
    """c"""
    push_back: NDArray[np.float64] | float
    """p, (tendons,) or one for all"""
    gravity_m_per_s2: float
    """Along -z."""
    ground_friction: float | None
    """Coulomb's coefficient of the ground it lies on; None: there is no ground, and the anchors are held."""
    rigid: tuple[tuple[int, ...], ...]
    """The nodes of each rigid body. Its distances are the last rods of the structure."""
    own_rods: int
    """Number of the rods that are no distances in rigid bodies."""
    knot_mass_kg: NDArray[np.float64] | float
    """(nodes,) or one for all: mass at the nodes, beside that of the rods."""
    hub_offset_m: NDArray[np.float64] | None = None
    """(tendons, 2, 3) from the node at either end of a tendon to the point at which the tendon ends, in the shape that
    the structure starts from. The offset turns with the rod of the node. None: tendons end at the nodes."""

    def end_site(self, tendon: int, end: int) -> str:
        """Return the name of the site at which a tendon ends: `nK` of its node K, or its own, `tE_0` or `tE_1`."""
        if self.hub_offset_m is None or not self.hub_offset_m[tendon, end].any():
            return f"n{self.structure.tendons[tendon, end]}"
        return f"t{tendon}_{end}"


def mjcf(body: Body, node_position_m: NDArray[np.float64], step_s: float) -> str:
    """Return the model file of a structure that starts at (nodes, 3) positions: `nK` is node K, `rE` is rod E."""
    root = Element("mujoco")
    SubElement(root, "compiler", inertiafromgeom="false")
    option = SubElement(root, "option", timestep=_text(step_s), gravity=_text([0, 0, -body.gravity_m_per_s2]))
    option.set("integrator", "implicitfast")
    world = SubElement(root, "worldbody")
    held = np.zeros(body.structure.node_count, dtype=np.bool_)
    if body.ground_friction is None:
        held[body.structure.anchors] = True
    else:
        option.set("cone", "elliptic")  # the other cone lets it slide at 0.7 of the friction in some directions
        option.set("impratio", "10")  # with 1, feet creep by a millimetre a second at half of the friction
        height_m = node_position_m[:, 2].min() - float(np.max(body.rod_radius_m))
        ground = SubElement(world, "geom", type="plane", size="10 10 1", pos=_text([0, 0, height_m]))
        ground.set("conaffinity", "0")
        _touching(ground, body.ground_friction, step_s)
    parts = _Parts(body, node_position_m, step_s, held)
    for rod in range(body.own_rods):
        parts.add_rod(world, rod)
    for nodes in body.rigid:
        parts.add_rigid(world, np.array(nodes))
    for node in np.flatnonzero([parts.placed[node] == 0 for node in range(body.structure.node_count)]):
        parts.add_knot(world, int(node))
    parts.tie(root)
    tendons = SubElement(root, "tendon")
    push_back = np.broadcast_to(body.push_back, len(body.structure.tendons))
    for tendon, (natural_m, k) in enumerate(zip(body.structure.natural_length_m, body.stiffness_n_per_m, strict=True)):
        ends = [body.end_site(tendon, end) for end in (0, 1)]
        # MuJoCo's springs exert no force between the two lengths
        _add_spring(tendons, ends, k, body.damping_n_s_per_m, [0.0, natural_m])
        _add_spring(tendons, ends, k * push_back[tendon], 0.0, [natural_m, FAR_M])
    return tostring(root, encoding="unicode")


@dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    """Adds rods, rigid bodies and single nodes to the world, each node once."""

    body: Body
    start_m: NDArray[np.float64]
    """(nodes, 3)"""
    step_s: float
    held: NDArray[np.bool_]
    """(nodes,) which nodes do not move."""
    placed: Counter[int] = field(default_factory=Counter)
    """How many sites each node has."""

    def add_rod(self, world: Element, rod: int) -> None:
        """Add a rod along its body's z axis, from first to second node: free, hinged at an end, or fixed."""
        body = self.body
        nodes = body.structure.rods[rod]
        length_m = float(body.structure.rod_length_m[rod])
        mass_kg, radius_m = (
            float(np.ravel(v)[rod if np.ndim(v) else 0]) for v in (body.rod_mass_kg, body.rod_radius_m)
        )
        start_m, held = self.start_m[nodes], self.held[nodes]
        along = (start_m[1] - start_m[0]) / np.linalg.norm(start_m[1] - start_m[0])
        turned = Rotation.align_vectors([along], [[0.0, 0.0, 1.0]])[0]
        x, y, z, w = turned.as_quat()
        pivot = held.argmax() if held.any() else slice(None)
        origin_m = start_m[pivot].reshape(-1, 3).mean(axis=0)
        ends_m = np.array([0.0, length_m])
        ends_m -= ends_m[pivot].mean()
        element = SubElement(world, "body", name=f"r{rod}", pos=_text(origin_m), quat=_text([w, x, y, z]))
        sideways = mass_kg * length_m**2 / 12
        lengthwise = mass_kg * radius_m**2 / 2
        SubElement(
            element,
            "inertial",
            pos=_text([0, 0, ends_m.mean()]),
            mass=_text(mass_kg),
            diaginertia=_text([sideways, sideways, lengthwise]),
        )
        _add_joints(element, held, body.rod_drag_n_s_per_m, length_m)
        for node, end_m in zip(nodes, ends_m, strict=True):
            self._add_node(element, int(node), np.array([0.0, 0.0, end_m]), radius_m)
            _add_hub(element, body, node, np.array([0.0, 0.0, end_m]), turned.inv())

    def add_rigid(self, world: Element, nodes: NDArray[np.int64]) -> None:
        """Add a rigid body about the middle of its nodes, whose masses are its mass: free, or fixed by held nodes."""
        middle_m = self.start_m[nodes].mean(axis=0)
        element = SubElement(world, "body", pos=_text(middle_m))
        wide_m = float(np.sqrt(np.mean(np.sum((self.start_m[nodes] - middle_m) ** 2, axis=1))))
        _add_joints(element, self.held[nodes[:1]], self.body.rod_drag_n_s_per_m, wide_m)
        for node in nodes.tolist():
            self._add_node(element, node, self.start_m[node] - middle_m, float(np.max(self.body.rod_radius_m)))

    def add_knot(self, world: Element, node: int) -> None:
        """Add a node that is on no rod and in no rigid body: fixed where it is held, else free to move."""
        if self.held[node]:
            SubElement(world, "site", name=f"n{node}", pos=_text(self.start_m[node]))
            self.placed[node] += 1
            return
        element = SubElement(world, "body", pos=_text(self.start_m[node]))
        _add_slides(element, self.body.rod_drag_n_s_per_m)
        self._add_node(element, node, np.zeros(3), float(np.max(self.body.rod_radius_m)))

    def tie(self, root: Element) -> None:
        """Tie the sites of each node that has several to one another; held ones are where they are."""
        ties = SubElement(root, "equality")
        for node, count in sorted(self.placed.items()):
            for copy in range(1, count if not self.held[node] else 1):
                tie = SubElement(ties, "connect", site1=f"n{node}", site2=f"n{node}_{copy}")
                tie.set("solref", _text([2 * self.step_s, 1]))  # as hard as the step allows
                tie.set("solimp", _text([0.9999, 0.9999, 0.001, 0.5, 2]))
        if not len(ties):
            root.remove(ties)

    def _add_node(self, element: Element, node: int, place_m: NDArray[np.float64], radius_m: float) -> None:
        """Add the site of a node, its own mass, and the round end that touches the ground."""
        copy, self.placed[node] = self.placed[node], self.placed[node] + 1
        SubElement(element, "site", name=f"n{node}_{copy}" if copy else f"n{node}", pos=_text(place_m))
        knot_kg = float(np.broadcast_to(self.body.knot_mass_kg, len(self.held))[node])
        if knot_kg > 0 and not copy:
            knot = SubElement(element, "body", pos=_text(place_m))
            inertia = 0.4 * knot_kg * radius_m**2
            SubElement(knot, "inertial", pos="0 0 0", mass=_text(knot_kg), diaginertia=_text([inertia] * 3))
        if self.body.ground_friction is not None:
            ball = SubElement(element, "geom", type="sphere", size=_text(radius_m), pos=_text(place_m))
            ball.set("contype", "0")  # with the ground alone, not with one another
            _touching(ball, self.body.ground_friction, self.step_s)


def _add_joints(part: Element, held: NDArray[np.bool_], drag_n_s_per_m: float, length_m: float) -> None:
    """Let a part move as its ends allow; each of them is held or free."""
    if not held.any():
        _add_slides(part, drag_n_s_per_m)
        SubElement(part, "joint", type="ball", damping=_text(drag_n_s_per_m * length_m**2 / 12))
    elif not held.all():
        SubElement(part, "joint", type="ball", damping=_text(drag_n_s_per_m * length_m**2 / 3))


def _add_slides(part: Element, drag_n_s_per_m: float) -> None:
    for axis in np.eye(3):
        SubElement(part, "joint", type="slide", axis=_text(axis), damping=_text(drag_n_s_per_m))


def _add_hub(rod: Element, body: Body, node: int, node_in_rod_m: NDArray[np.float64], into_rod: Rotation) -> None:
    """Add the sites at which the tendons of a node end, if this is not the node itself."""
    if body.hub_offset_m is None:
        return
    for tendon, end in np.argwhere(body.structure.tendons == node):
        if (site := body.end_site(tendon, end)).startswith("t"):
            place_m = node_in_rod_m + into_rod.apply(body.hub_offset_m[tendon, end])
            SubElement(rod, "site", name=site, pos=_text(place_m))


def _touching(geom: Element, friction: float, step_s: float) -> None:
    """Let a geom touch the ground, as hard as the step allows (twice the step is MuJoCo's limit)."""
    geom.set("friction", _text([friction, 0, 0]))
    geom.set("solref", _text([4 * step_s, 1]))


def _add_spring(tendons: Element, ends: list[str], stiffness: float, damping: float, slack_m: ArrayLike) -> None:
    spring = SubElement(
        tendons, "spatial", stiffness=_text(stiffness), damping=_text(damping), springlength=_text(slack_m)
    )
    for site in ends:
        SubElement(spring, "site", site=site)


def _text(value: ArrayLike) -> str:
    return " ".join(repr(float(number)) for number in np.ravel(value))
