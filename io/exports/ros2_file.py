"""A run as a recording of ROS 2 in one MCAP file, written without ROS."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.structure.reconstruction import Reconstruction
from ...models.structure.shape import Shape
from ...models.structure.structure import Structure
from ...models.values.errors import InputError, needs_extra
from .solids import Solid, axes_along, carried_along, solids_of

UNKNOWN_TURN_RAD2 = float(np.pi**2 / 3)
"""Variance of an angle of which nothing is known: a node has no orientation."""
SPHERE, LINE_LIST = 2, 5
"""Types of `visualization_msgs/Marker`."""
NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])
"""A quaternion."""


def write_ros2(result: Reconstruction, probability: float, path: Path) -> None:
    """Write poses of nodes, transforms of rods, and markers of rods, tendons and ellipsoids, frame by frame.

    Args:
        result: the run, whose times are the stamps.
        probability: of the ellipsoids.
        path: of the file.

    Raises:
        InputError: when rosbags is not installed, or a time is before 0, which ROS has no stamp for.
    """
    with needs_extra("ROS 2", "ros2"):
        from rosbags.rosbag2 import StoragePlugin, Writer
    if result.t_s[0] < 0:
        raise InputError(f"{path.name}: expected times from 0 on, got {result.t_s[0]:.4f} s")
    messages = Messages(result.structure, result.coordinate_frame)
    with TemporaryDirectory(dir=path.parent) as folder:
        bag = Path(folder) / path.stem
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            topics: dict[str, Any] = {}
            for shape in result:
                stamp_ns = round(1e9 * shape.t_s)
                for topic, message in messages.of(shape, probability, stamp_ns):
                    if topic not in topics:
                        kind = message.__msgtype__
                        topics[topic] = writer.add_connection(topic, kind, typestore=messages.types)
                    data = messages.types.serialize_cdr(message, message.__msgtype__)
                    writer.write(topics[topic], stamp_ns, data)
        (bag / f"{bag.name}.mcap").replace(path)


class Messages:
    """Makes the messages of one frame after the other.

    rosbags compiles what serialises a kind of message when it first meets it, and keeps it: that takes ten times as
    long as all messages of a frame.
    """

    def __init__(self, structure: Structure, frame_id: str) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.types = get_typestore(Stores.ROS2_HUMBLE)
        self._structure = structure
        self._frame_id = frame_id
        self._rod_axes: list[NDArray[np.float64]] = []
        """Those of the last frame."""

    def of(self, shape: Shape, probability: float, stamp_ns: int) -> Iterator[tuple[str, Any]]:
        """Yield the topic and the message of each node, of the transforms, and of the markers."""
        header = self._make(
            "std_msgs/msg/Header",
            stamp=self._make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9),
            frame_id=self._frame_id,
        )
        for node in range(self._structure.node_count):
            yield f"/tensegraph/node_{node}/pose", self._node_pose(header, shape, node)
        yield "/tf", self._rod_transforms(header, self._structure.rods, shape.node_position_m)
        yield "/tensegraph/markers", self._markers(header, list(solids_of(self._structure, shape, probability)))

    def _make(self, kind: str, **values: Any) -> Any:
        return self.types.types[kind](**values)

    def _vector(self, kind: str, values: NDArray[np.float64]) -> Any:
        return self._make(f"geometry_msgs/msg/{kind}", **dict(zip("xyzw", map(float, values), strict=False)))

    def _pose(self, position_m: NDArray[np.float64], quaternion: NDArray[np.float64]) -> Any:
        return self._make(
            "geometry_msgs/msg/Pose",
            position=self._vector("Point", position_m),
            orientation=self._vector("Quaternion", quaternion),
        )

    def _node_pose(self, header: Any, shape: Shape, node: int) -> Any:
        """Return a pose whose orientation is none, as its variance says."""
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = shape.node_covariance_m2[node]
        covariance[3:, 3:] = UNKNOWN_TURN_RAD2 * np.eye(3)
        pose = self._make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=self._pose(shape.node_position_m[node], NO_TURN),
            covariance=covariance.ravel(),
        )
        return self._make("geometry_msgs/msg/PoseWithCovarianceStamped", header=header, pose=pose)

    def _rod_transforms(self, header: Any, rods: NDArray[np.int64], position_m: NDArray[np.float64]) -> Any:
        """Return the frame of each rod: at its middle, z towards its second node."""
        from scipy.spatial.transform import Rotation

        along_m = position_m[rods[:, 1]] - position_m[rods[:, 0]]
        before = self._rod_axes or [axes_along(rod_m) for rod_m in along_m]
        self._rod_axes = [carried_along(axes, rod_m) for axes, rod_m in zip(before, along_m, strict=True)]
        middle_m = position_m[rods].mean(axis=1)
        transforms = [
            self._make(
                "geometry_msgs/msg/TransformStamped",
                header=header,
                child_frame_id=f"rod_{k}",
                transform=self._make(
                    "geometry_msgs/msg/Transform",
                    translation=self._vector("Vector3", middle_m[k]),
                    rotation=self._vector("Quaternion", quaternion),
                ),
            )
            for k, quaternion in enumerate(Rotation.from_matrix(self._rod_axes).as_quat())
        ]
        return self._make("tf2_msgs/msg/TFMessage", transforms=transforms)

    def _markers(self, header: Any, solids: Sequence[Solid]) -> Any:
        """Return lines for the rods, lines for the tendons, and an ellipsoid of each node."""
        groups: dict[str, list[Solid]] = {}
        for solid in solids:
            groups.setdefault(solid.name.split()[0], []).append(solid)
        markers = [self._lines(header, name, groups.pop(name)) for name in ("rod", "tendon")]
        for number, solid in enumerate(groups.pop("ellipsoid")):
            markers.append(
                self._marker(
                    header,
                    ns="ellipsoid",
                    id=number,
                    type=SPHERE,
                    pose=self._pose(solid.center_m, solid.quaternion),
                    scale=self._vector("Vector3", 2 * solid.half_size_m),
                    color=self._color(solid),
                )
            )
        return self._make("visualization_msgs/msg/MarkerArray", markers=markers)

    def _lines(self, header: Any, name: str, solids: Sequence[Solid]) -> Any:
        """Return one marker with a line along each cylinder, as wide as the first."""
        half_m = [solid.half_size_m[2] * solid.axes[:, 2] for solid in solids]
        ends_m = [solid.center_m + sign * half for solid, half in zip(solids, half_m, strict=True) for sign in (-1, 1)]
        return self._marker(
            header,
            ns=name,
            id=0,
            type=LINE_LIST,
            pose=self._pose(np.zeros(3), NO_TURN),
            scale=self._vector("Vector3", np.array([2 * solids[0].half_size_m[0], 0.0, 0.0])),
            color=self._color(solids[0]),
            points=[self._vector("Point", end_m) for end_m in ends_m],
            colors=[color for solid in solids for color in [self._color(solid)] * 2],
        )

    def _color(self, solid: Solid) -> Any:
        return self._make("std_msgs/msg/ColorRGBA", **dict(zip("rgba", solid.color, strict=True)))

    def _marker(self, header: Any, **values: Any) -> Any:
        """Return a marker with the values, and nothing in its other fields."""
        none = np.empty(0, dtype=np.uint8)
        empty = {
            "action": 0,
            "lifetime": self._make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
            "frame_locked": False,
            "points": [],
            "colors": [],
            "texture_resource": "",
            "texture": self._make("sensor_msgs/msg/CompressedImage", header=header, format="", data=none),
            "uv_coordinates": [],
            "text": "",
            "mesh_resource": "",
            "mesh_file": self._make("visualization_msgs/msg/MeshFile", filename="", data=none),
            "mesh_use_embedded_materials": False,
        }
        return self._make("visualization_msgs/msg/Marker", header=header, **{**empty, **values})
