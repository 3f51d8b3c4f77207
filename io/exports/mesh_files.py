"""One shape as a mesh for viewers and printers of solids: PLY, and glTF's binary form."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .solids import Solid, unit_mesh

Z_UP_TO_Y_UP = (-float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5)))
"""x, y, z, w of the turn by -90 degrees about x: glTF's vertical axis is y, ours is z."""
FLOAT, WHOLE = 5126, 5125
"""glTF's numbers for the types of 32 bits."""


def write_ply(solids: Sequence[Solid], about: Mapping[str, Any], path: Path) -> None:
    """Write all solids as one mesh with colours, in metres, in binary form.

    Args:
        solids: of one shape, see `solids_of`.
        about: what the comments in the head of the file say.
        path: of the file.
    """
    vertex = np.dtype([("position", "<f4", 3), ("color", "u1", 4)])
    face = np.dtype([("count", "u1"), ("point", "<i4", 3)])
    vertices, faces, offset = [], [], 0
    for solid in solids:
        mesh = unit_mesh(solid.kind)
        vertices.append(np.empty(len(mesh.points), vertex))
        vertices[-1]["position"] = solid.placed_m(mesh.points)
        vertices[-1]["color"] = np.round(255 * np.array(solid.color))
        faces.append(np.empty(len(mesh.triangles), face))
        faces[-1]["count"], faces[-1]["point"] = 3, mesh.triangles + offset
        offset += len(mesh.points)
    head = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {name} = {value}" for name, value in {"unit": "m", **about}.items()),
        f"element vertex {offset}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {color}" for color in ("red", "green", "blue", "alpha")),
        f"element face {sum(map(len, faces))}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    parts = [part.tobytes() for part in (*vertices, *faces)]
    path.write_bytes("\n".join([*head, ""]).encode("ascii", "replace") + b"".join(parts))


def write_gltf(solids: Sequence[Solid], about: Mapping[str, Any], path: Path) -> None:
    """Write a scene of named parts in metres: each is the unit sphere or cylinder, with its scale, turn and place.

    Args:
        solids: of one shape, see `solids_of`.
        about: the `extras` of the root of the scene.
        path: of the file, which ends in .glb.
    """
    geometry, binary = _geometry()
    colors = sorted({solid.color for solid in solids})
    drawn = sorted({(solid.kind, solid.color) for solid in solids})
    parts = [
        {
            "name": solid.name,
            "mesh": drawn.index((solid.kind, solid.color)),
            "scale": solid.half_size_m.tolist(),
            "rotation": solid.quaternion.tolist(),
            "translation": solid.center_m.tolist(),
        }
        for solid in solids
    ]
    children = list(range(1, 1 + len(parts)))
    root = {"name": "tensegraph", "rotation": Z_UP_TO_Y_UP, "children": children, "extras": dict(about)}
    primitives = {"cylinder": {"attributes": {"POSITION": 0}, "indices": 1}}
    primitives["sphere"] = {"attributes": {"POSITION": 2, "NORMAL": 2}, "indices": 3}
    document = {
        "asset": {"version": "2.0", "generator": "tensegraph"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [root, *parts],
        "meshes": [{"primitives": [{**primitives[kind], "material": colors.index(color)}]} for kind, color in drawn],
        "materials": [_material(color) for color in colors],
        **geometry,
        "buffers": [{"byteLength": len(binary)}],
    }
    path.write_bytes(_glb(json.dumps(document).encode(), binary))


def _geometry() -> tuple[dict[str, Any], bytes]:
    """Return accessors and views of the points and triangles of cylinder and sphere, and their bytes."""
    binary = b""
    accessors: list[dict[str, Any]] = []
    views: list[dict[str, int]] = []
    for kind in ("cylinder", "sphere"):
        mesh = unit_mesh(kind)
        points = mesh.points.astype("<f4")
        for values, code, target in ((points, FLOAT, 34962), (mesh.triangles.astype("<u4"), WHOLE, 34963)):
            views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes, "target": target})
            accessors.append({"bufferView": len(views) - 1, "componentType": code, **_counted(values, code)})
            binary += values.tobytes()
    return {"accessors": accessors, "bufferViews": views}, binary


def _counted(values: NDArray[Any], code: int) -> dict[str, Any]:
    if code == WHOLE:
        return {"type": "SCALAR", "count": values.size}
    return {
        "type": "VEC3",
        "count": len(values),
        "min": values.min(axis=0).tolist(),
        "max": values.max(axis=0).tolist(),
    }


def _material(color: tuple[float, float, float, float]) -> dict[str, Any]:
    """Return a material, whose colour glTF takes as linear light."""
    linear = [((value + 0.055) / 1.055) ** 2.4 if value > 0.04045 else value / 12.92 for value in color[:3]]
    return {
        "pbrMetallicRoughness": {"baseColorFactor": [*linear, color[3]], "metallicFactor": 0.0},
        "alphaMode": "OPAQUE" if color[3] == 1 else "BLEND",
    }


def _glb(document: bytes, binary: bytes) -> bytes:
    """Return the binary form: a head, then both parts, each with its length and kind, filled up to four bytes."""
    document += b" " * (-len(document) % 4)
    chunks = b"".join(
        len(part).to_bytes(4, "little") + kind + part for kind, part in ((b"JSON", document), (b"BIN\0", binary))
    )
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks
