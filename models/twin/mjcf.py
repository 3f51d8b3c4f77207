"""A structure as MuJoCo's model file (MJCF).

A tendon between nodes a and b, of length l, natural length L0, stiffness k and damping c, pulls with

    T = k (l - L0) + c dl/dt       l >= L0
    T = p k (l - L0) + c dl/dt     l <  L0: a bent strip pushes back a little, p << 1

A rod of mass m and length l is uniform and thin (inertia m l^2 / 12 about its middle), and drag acts on all of its
length alike: force -d v and moment -(d l^2 / 12) w about its middle. Rods and tendons pass through one another.
"""

from dataclasses import dataclass
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
    rod_mass_kg: float
    rod_radius_m: float
    """Of the rod, and of its round ends, which touch the ground."""
    rod_drag_n_s_per_m: float
    """d"""
    stiffness_n_per_m: NDArray[np.float64]
    """(tendons,) k"""
    damping_n_s_per_m: float
    """c"""
    push_back: float
    """p"""
    gravity_m_per_s2: float
    """Along -z."""
    ground_friction: float | None
    """Coulomb's coefficient of the ground it lies on; None: there is no ground, and the anchors are held."""
    hub_offset_m: NDArray[np.float64] | None = None
    """(tendons, 2, 3) from the node at either end of a tendon to the point at which the tendon ends, in the shape that
    the structure starts from. The offset turns with the rod of the node. None: tendons end at the nodes."""

    def end_site(self, tendon: int, end: int) -> str:
        """Return the name of the site at which a tendon ends: `nK` of its node K, or its own, `tE_0` or `tE_1`."""
        if self.hub_offset_m is None or not self.hub_offset_m[tendon, end].any():
            return f"n{self.structure.tendons[tendon, end]}"
        return f"t{tendon}_{end}"


def mjcf(body: Body, node_position_m: NDArray[np.float64], step_s: float) -> str:
    """Return the model file of a structure that starts at (nodes, 3) positions; site `nK` is node K."""
    root = Element("mujoco")
    SubElement(root, "compiler", inertiafromgeom="false")
    option = SubElement(root, "option", timestep=_text(step_s), gravity=_text([0, 0, -body.gravity_m_per_s2]))
    option.set("integrator", "implicitfast")
    world = SubElement(root, "worldbody")
    held = np.zeros(body.structure.node_count, dtype=np.bool_)
    if body.ground_friction is None:
        held[body.structure.anchors] = True
    else:
        height_m = node_position_m[:, 2].min() - body.rod_radius_m
        ground = SubElement(world, "geom", type="plane", size="10 10 1", pos=_text([0, 0, height_m]))
        ground.set("conaffinity", "0")
        _touching(ground, body.ground_friction, step_s)
    for nodes, length_m in zip(body.structure.rods, body.structure.rod_length_m, strict=True):
        fixed_first = nodes[np.argsort(~held[nodes], kind="stable")]
        _add_rod(world, body, fixed_first, held[fixed_first], node_position_m[fixed_first], float(length_m), step_s)
    for node in np.setdiff1d(np.flatnonzero(held), body.structure.rods):
        SubElement(world, "site", name=f"n{node}", pos=_text(node_position_m[node]))
    tendons = SubElement(root, "tendon")
    for tendon, (natural_m, k) in enumerate(zip(body.structure.natural_length_m, body.stiffness_n_per_m, strict=True)):
        ends = [body.end_site(tendon, end) for end in (0, 1)]
        # MuJoCo's springs exert no force between the two lengths
        _add_spring(tendons, ends, k, body.damping_n_s_per_m, [0.0, natural_m])
        _add_spring(tendons, ends, k * body.push_back, 0.0, [natural_m, FAR_M])
    return tostring(root, encoding="unicode")


def _add_rod(
    world: Element,
    body: Body,
    nodes: NDArray[np.int64],
    held: NDArray[np.bool_],
    start_m: NDArray[np.float64],
    length_m: float,
    step_s: float,
) -> None:
    """Add a rod along its body's z axis: free about its middle, hinged at its held first end, or fixed."""
    along = (start_m[1] - start_m[0]) / np.linalg.norm(start_m[1] - start_m[0])
    turned = Rotation.align_vectors([along], [[0.0, 0.0, 1.0]])[0]
    x, y, z, w = turned.as_quat()
    origin_m = start_m[0] if held[0] else start_m.mean(axis=0)
    ends_m = np.array([0.0, length_m]) if held[0] else np.array([-length_m, length_m]) / 2
    rod = SubElement(world, "body", pos=_text(origin_m), quat=_text([w, x, y, z]))
    sideways = body.rod_mass_kg * length_m**2 / 12
    lengthwise = body.rod_mass_kg * body.rod_radius_m**2 / 2
    SubElement(
        rod,
        "inertial",
        pos=_text([0, 0, ends_m.mean()]),
        mass=_text(body.rod_mass_kg),
        diaginertia=_text([sideways, sideways, lengthwise]),
    )
    _add_joints(rod, held, body.rod_drag_n_s_per_m, length_m)
    for node, end_m in zip(nodes, ends_m, strict=True):
        end_in_rod_m = np.array([0.0, 0.0, end_m])
        _add_end(rod, body, node, end_in_rod_m, step_s)
        _add_hub(rod, body, node, end_in_rod_m, turned.inv())


def _add_joints(rod: Element, held: NDArray[np.bool_], drag_n_s_per_m: float, length_m: float) -> None:
    """Let a rod move as its two ends allow; (2,) ends are held or free."""
    if not held.any():
        for axis in np.eye(3):
            SubElement(rod, "joint", type="slide", axis=_text(axis), damping=_text(drag_n_s_per_m))
        SubElement(rod, "joint", type="ball", damping=_text(drag_n_s_per_m * length_m**2 / 12))
    elif not held.all():
        SubElement(rod, "joint", type="ball", damping=_text(drag_n_s_per_m * length_m**2 / 3))


def _add_end(rod: Element, body: Body, node: int, node_in_rod_m: NDArray[np.float64], step_s: float) -> None:
    """Add the site of a node, and the round end that touches the ground."""
    SubElement(rod, "site", name=f"n{node}", pos=_text(node_in_rod_m))
    if body.ground_friction is not None:
        ball = SubElement(rod, "geom", type="sphere", size=_text(body.rod_radius_m), pos=_text(node_in_rod_m))
        ball.set("contype", "0")  # with the ground alone, not with one another
        _touching(ball, body.ground_friction, step_s)


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
