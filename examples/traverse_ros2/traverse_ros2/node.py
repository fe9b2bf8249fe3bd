"""The node: `ros2 run traverse_ros2 node`, or `traverse gateway ros2`."""

import array
import importlib
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from traverse import Arm
from traverse.__main__ import main as run_traverse
from traverse.client.exports.ros_messages import BASE_FRAME, RosMessage
from traverse_ros2.feed import feed

if TYPE_CHECKING:
    from rclpy.publisher import Publisher as RosPublisher

M = TypeVar("M")
DEPTH = 100  # messages that wait for a slow subscriber


class HasFields(Protocol):
    """What every message of ROS has."""

    def get_fields_and_field_types(self) -> dict[str, str]: ...


class Publisher(Node):
    """Publishes messages, each on the topic that its first one makes."""

    def __init__(self) -> None:
        super().__init__("traverse")
        self._publishers_of: dict[str, RosPublisher | None] = {}

    def publish(self, message: RosMessage) -> None:
        """Publish one; a kind that ROS does not have here is left out, and reported."""
        if message.topic not in self._publishers_of:
            self._publishers_of[message.topic] = self._publisher(message)
        publisher = self._publishers_of[message.topic]
        if publisher is not None:
            publisher.publish(filled(publisher.msg_type(), message.content))

    def _publisher(self, message: RosMessage) -> "RosPublisher | None":
        package, _, name = message.kind.split("/")
        try:
            kind = getattr(importlib.import_module(f"{package}.msg"), name)
        except ImportError as error:
            self.get_logger().warning(f"nothing on {message.topic}: {error}")
            return None
        topic = message.topic if message.topic.startswith("/") else f"~/{message.topic}"
        return self.create_publisher(kind, topic, DEPTH)


def filled(message: M, content: Mapping[str, Any]) -> M:
    """Fill the fields of a message, and of those within it."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            filled(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            setattr(message, name, [filled(_item(message, name), v) for v in value])
        elif isinstance(value, bytes):
            setattr(message, name, array.array("B", value))
        else:
            setattr(message, name, value)
    return message


def _item(message: HasFields, name: str) -> HasFields:
    """Return a new item of a field that is a list of messages."""
    kind = message.get_fields_and_field_types()[name]  # sequence<package/Name>
    package, _, of_items = kind.removeprefix("sequence<").rstrip(">").partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), of_items)()


async def ros2(arm: Arm, *, joints: str = "", frame: str = BASE_FRAME) -> None:
    """Publish poses, points and scans of an arm to ROS 2.

    Args:
        arm: Connected, and disconnected afterwards, by Traverse.
        joints: Their names from the base outwards, with commas between.
        frame: Name of the arm's system.
    """
    if not rclpy.ok():
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = Publisher()
    names = joints.split(",") if joints else ()
    try:
        logger = node.get_logger()
        await feed(arm, node.publish, logger.warning, joints=names, frame=frame)
    finally:
        node.destroy_node()
        rclpy.shutdown()


def main() -> None:
    """Run the gateway with its options; those behind `--ros-args` are ROS's."""
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    sys.argv[:] = ["traverse", "gateway", "ros2", *remove_ros_args(sys.argv)[1:]]
    run_traverse()
