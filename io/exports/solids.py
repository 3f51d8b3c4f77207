"""A shape as solids in space: rods and tendons are cylinders, confidence regions are ellipsoids."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...models.structure.shape import Shape
from ...models.structure.structure import Structure
from ..figures.style import BLACK, RED, color_of, tendon_style

ROD_RADIUS = 0.01
"""Radius of the cylinder of a rod, as a share of the mean length of the rods."""
TENDON_RADIUS = 0.003
"""The same for a tendon."""
OPACITY = 0.4
"""Of an ellipsoid, through which its node is seen."""
NEARLY_ALONG = 0.1
"""Sine of the angle between a rod and an axis below which the axis does not tell a direction across the rod."""


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A sphere of radius 1, or a cylinder of radius 1 from z = -1 to 1, that is stretched, turned, then moved."""

    name: str
    kind: Literal["cylinder", "sphere"]
    half_size_m: NDArray[np.float64]
    """(3,) factors along its own x, y, z: semi-axes; radius, radius, half the length."""
    axes: NDArray[np.float64]
    """(3, 3) columns are its own x, y, z in space."""
    center_m: NDArray[np.float64]
    """(3,)"""
    color: tuple[float, float, float, float]
    """Red, green, blue of sRGB, and opacity, from 0 to 1."""

    @property
    def quaternion(self) -> NDArray[np.float64]:
        """(4,) x, y, z, w of the rotation that `axes` is."""
        from scipy.spatial.transform import Rotation  # imported where such a file is written

        return np.asarray(Rotation.from_matrix(self.axes).as_quat())

    def placed_m(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(points, 3) where (points, 3) of the sphere or the cylinder are in space."""
        return self.center_m + (points * self.half_size_m) @ self.axes.T


def solids_of(structure: Structure, shape: Shape, probability: float) -> Iterator[Solid]:
    """Yield the solids of a shape: rods, tendons in the colour of their mode, and the ellipsoids of free nodes.

    Args:
        structure: rods and tendons.
        shape: node positions and covariances.
        probability: of the ellipsoids.
    """
    position_m = shape.node_position_m
    unit_m = float(structure.rod_length_m.mean())
    for k, (a, b) in enumerate(structure.rods):
        yield _member(f"rod {k} ({a}-{b})", position_m[[a, b]], ROD_RADIUS * unit_m, color_of(BLACK))
    for e, (a, b) in enumerate(structure.tendons):
        color = color_of(tendon_style(shape.lengths.length_m[e], int(shape.lengths.mode[e]))["color"])
        yield _member(f"tendon {e} ({a}-{b})", position_m[[a, b]], TENDON_RADIUS * unit_m, color)
    regions = shape.ellipsoids(probability)
    for node in structure.free_nodes:
        yield Solid(
            name=f"ellipsoid of node {node}",
            kind="sphere",
            half_size_m=regions.semi_axis_m[node],
            axes=regions.axes[node],
            center_m=position_m[node],
            color=color_of(RED, OPACITY),
        )


def axes_along(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) right-handed axes as columns, of which z is along a (3,) direction; how far they turn about it is free.

    Duff et al., Building an Orthonormal Basis, Revisited, JCGT 6, 2017. A direction of no length may have any axes.
    """
    length = np.linalg.norm(direction)
    x, y, z = direction / length if length > 0 else (0.0, 0.0, 1.0)
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    return np.array([[1 + sign * x * x * a, x * y * a, x], [sign * x * y * a, sign + y * y * a, y], [-sign * x, -y, z]])


def carried_along(axes: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) `axes_along` a direction that turn about it as little as they can from those of the instant before.

    Those of `axes_along` alone turn by up to half a turn where a direction passes the horizontal.
    """
    length = np.linalg.norm(direction)
    z = direction / length if length > 0 else axes[:, 2]
    x = axes[:, 0] - (axes[:, 0] @ z) * z
    across = np.linalg.norm(x)
    if across < NEARLY_ALONG:
        return axes_along(direction)
    return np.column_stack([x / across, np.cross(z, x / across), z])


def _member(name: str, end_m: NDArray[np.float64], radius_m: float, color: tuple[float, float, float, float]) -> Solid:
    along_m = end_m[1] - end_m[0]
    half_size_m = np.array([radius_m, radius_m, 0.5 * float(np.linalg.norm(along_m))])
    return Solid(name, "cylinder", half_size_m, axes_along(along_m), end_m.mean(axis=0), color)


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles, counter-clockwise as seen from outside."""

    points: NDArray[np.float64]
    """(points, 3)"""
    triangles: NDArray[np.int64]
    """(triangles, 3) numbers of points."""


def unit_mesh(kind: Literal["cylinder", "sphere"], sides: int = 24) -> Mesh:
    """Return a closed mesh of the sphere or the cylinder of `Solid`, with so many points around z.

    Between a first and a last point on z are rings of points: two of a cylinder, `sides / 2 - 1` of a sphere.
    """
    if kind == "cylinder":
        ring_radius, ring_z = np.ones(2), np.array([-1.0, 1.0])
    else:
        inclination = np.pi * np.arange(1, sides // 2) / (sides // 2)
        ring_radius, ring_z = np.sin(inclination), -np.cos(inclination)
    turn = 2 * np.pi * np.arange(sides) / sides
    rings = np.empty((len(ring_z), sides, 3))
    rings[..., 0] = ring_radius[:, None] * np.cos(turn)
    rings[..., 1] = ring_radius[:, None] * np.sin(turn)
    rings[..., 2] = ring_z[:, None]
    points = np.concatenate([[[0.0, 0.0, -1.0]], rings.reshape(-1, 3), [[0.0, 0.0, 1.0]]])
    return Mesh(points, _triangles(len(ring_z), sides))


def _triangles(rings: int, sides: int) -> NDArray[np.int64]:
    """Return the triangles between rings of points, and to the first and the last point."""
    here = np.arange(sides)
    following = (here + 1) % sides
    first = [np.stack([0 * here, 1 + following, 1 + here], axis=1)]
    for ring in range(rings - 1):
        low, high = 1 + ring * sides, 1 + (ring + 1) * sides
        first.append(np.stack([low + here, low + following, high + following], axis=1))
        first.append(np.stack([low + here, high + following, high + here], axis=1))
    top = 1 + (rings - 1) * sides
    return np.concatenate([*first, np.stack([top + here, top + following, 0 * here + top + sides], axis=1)])
