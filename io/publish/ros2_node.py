"""Shapes as messages of ROS 2, from a node in the user's own installation: the same messages as the export."""

import os
from importlib import import_module
from multiprocessing.queues import Queue
from typing import Any

from ...models.structure.reconstruction import coordinate_frame_of
from ...models.structure.shape import Shape
from ...models.structure.structure import Structure
from ...models.values.errors import InputError, needs_extra
from ..exports.ros2_file import Messages
from ..viewer.shape_process import ShapeProcess, arrived_shapes

NODE = "tensegraph"
QUEUE_DEPTH = 10
"""Number of messages that ROS 2 keeps for a slow subscriber."""
WAIT_S = 0.1
"""Time between two looks at whether the session has ended."""


def ros2_publisher(structure: Structure, probability: float, *, remote: bool) -> ShapeProcess:
    """Return a process with a node of ROS 2 that publishes the newest shape; a context manager that ends it.

    Args:
        structure: whose shapes are published.
        probability: of the ellipsoids.
        remote: whether ROS 2 may look for listeners on other machines.
    """
    return ShapeProcess(publish_shapes, structure, probability, remote)


def check_ros2() -> None:
    """Check, before any work, that shapes can be published.

    Raises:
        InputError: without rclpy, which comes with ROS 2, or without rosbags.
    """
    with needs_extra("--publish ros2", "ros2"):
        import_module("rosbags.typesys")
    try:
        import_module("rclpy")
    except ImportError as error:  # missing, or compiled for another Python
        raise InputError(f"--publish ros2 needs rclpy: source the setup.bash of ROS 2 first: {error}") from error


def publish_shapes(shapes: "Queue[Shape]", structure: Structure, probability: float, remote: bool) -> None:
    """Publish shapes as they arrive, until the session has ended."""
    if not remote:
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy = import_module("rclpy")
    rclpy.init()
    node = Ros2Node(rclpy.create_node(NODE), structure, probability)
    for arrived in arrived_shapes(shapes, WAIT_S):
        for shape in arrived:
            node.add(shape)


class Ros2Node:
    """Publishes shapes on the topics of the export.

    rosbags serialises the messages, as in the export, and rclpy passes the bytes on. Stamps are the node's time when a
    shape is published: the clock of a trial is not that of ROS.
    """

    def __init__(self, node: Any, structure: Structure, probability: float) -> None:
        """Begin with no topic; each is advertised with its first message.

        Args:
            node: of rclpy.
            structure: whose shapes are published.
            probability: of the ellipsoids.
        """
        self._node = node
        self._structure = structure
        self._probability = probability
        self._messages: Messages | None = None
        self._publishers: dict[str, Any] = {}

    def add(self, shape: Shape) -> None:
        """Publish the messages of a shape."""
        if self._messages is None:  # only a shape tells whether there is a floor
            frame_id = coordinate_frame_of(self._structure, has_floor=shape.contacts is not None)
            self._messages = Messages(self._structure, frame_id)
        stamp_ns = self._node.get_clock().now().nanoseconds
        for topic, message in self._messages.of(shape, self._probability, stamp_ns):
            kind = message.__msgtype__
            if topic not in self._publishers:
                package, _, name = kind.split("/")
                message_class = getattr(import_module(f"{package}.msg"), name)
                self._publishers[topic] = self._node.create_publisher(message_class, topic, QUEUE_DEPTH)
            self._publishers[topic].publish(bytes(self._messages.types.serialize_cdr(message, kind)))
