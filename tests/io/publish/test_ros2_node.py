"""Messages of ROS 2 as rclpy gets them, read by another library; the node itself is a stand-in: ROS 2 is not here."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from tensegraph import InputError
from tensegraph.io.publish.ros2_node import Ros2Node, check_ros2

KINDS = {
    "geometry_msgs": "PoseWithCovarianceStamped",
    "tf2_msgs": "TFMessage",
    "visualization_msgs": "MarkerArray",
}


class StandInNode:
    """Keeps what is published; its clock stands at 1700000000.5 s."""

    def __init__(self) -> None:
        self.published: dict[tuple[str, str], list[bytes]] = {}

    def get_clock(self) -> SimpleNamespace:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=1_700_000_000_500_000_000))

    def create_publisher(self, kind: type, topic: str, depth: int) -> SimpleNamespace:
        assert (kind.__name__, topic) not in {(name, of) for name, of in self.published}, "advertised twice"
        kept = self.published[kind.__name__, topic] = []
        return SimpleNamespace(publish=kept.append)


@pytest.fixture
def ros2(monkeypatch) -> None:
    """Modules with the classes that name the messages."""
    for package, name in KINDS.items():
        module = ModuleType(f"{package}.msg")
        setattr(module, name, type(name, (), {}))
        monkeypatch.setitem(sys.modules, package, ModuleType(package))
        monkeypatch.setitem(sys.modules, f"{package}.msg", module)


def test_the_messages_are_those_of_the_export(short_run, ros2) -> None:
    typesys = pytest.importorskip("rosbags.typesys")
    types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    node = StandInNode()
    publisher = Ros2Node(node, short_run.structure, 0.5)
    shapes = [shape for _, shape in zip(range(3), short_run, strict=False)]
    for shape in shapes:
        publisher.add(shape)
    assert len(node.published) == 12 + 2
    data = node.published["PoseWithCovarianceStamped", "/tensegraph/node_7/pose"]
    assert [type(message) for message in data] == [bytes] * 3  # rclpy publishes bytes as they are
    pose = types.deserialize_cdr(data[2], "geometry_msgs/msg/PoseWithCovarianceStamped")
    assert (pose.header.stamp.sec, pose.header.stamp.nanosec) == (1_700_000_000, 500_000_000)
    position = pose.pose.pose.position
    np.testing.assert_array_equal([position.x, position.y, position.z], shapes[2].node_position_m[7])
    markers = types.deserialize_cdr(
        node.published["MarkerArray", "/tensegraph/markers"][0], "visualization_msgs/msg/MarkerArray"
    )
    assert [marker.ns for marker in markers.markers] == ["rod", "tendon", *["ellipsoid"] * 9]


def test_messages_are_compiled_once(short_run, ros2, monkeypatch) -> None:
    """That of each shape took ten times as long as all the rest of it."""
    typesys = pytest.importorskip("rosbags.typesys")
    made, make = [], typesys.get_typestore
    monkeypatch.setattr(typesys, "get_typestore", lambda store: made.append(store) or make(store))
    publisher = Ros2Node(StandInNode(), short_run.structure, 0.5)
    shapes = short_run[0.0:0.1]
    assert len(shapes) > 1
    for shape in shapes:
        publisher.add(shape)
    assert len(made) == 1


def test_without_rclpy_one_line_says_what_to_do(monkeypatch) -> None:
    pytest.importorskip("rosbags")
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(InputError, match=r"needs rclpy: source the setup.bash of ROS 2 first"):
        check_ros2()
