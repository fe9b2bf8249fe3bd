"""Points and scans as ROS 2 messages in an MCAP file, in metres, without ROS.

Topics are those of `ros_messages`, below /traverse; joint states are the readings of
each point. Definitions are from ROS 2's common interfaces.
"""

from collections.abc import Sequence
from typing import IO

from traverse.client.exports.point_table import Coordinates, PointTable, Sink
from traverse.client.exports.ros_messages import (
    BASE_FRAME,
    RosMessage,
    joint_states,
    point_messages,
    scan_messages,
)
from traverse.protocol.messages import Point

END_OF_TIME_NS = 2**31 * 10**9  # seconds have 31 bits
_HEADER = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_PLACE = """
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
"""
DEFINITIONS = {
    "geometry_msgs/msg/PointStamped": f"""std_msgs/Header header
geometry_msgs/Point point{_HEADER}{_PLACE}""",
    "geometry_msgs/msg/PoseWithCovarianceStamped": f"""std_msgs/Header header
geometry_msgs/PoseWithCovariance pose
================================================================================
MSG: geometry_msgs/PoseWithCovariance
geometry_msgs/Pose pose
float64[36] covariance
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1{_HEADER}{_PLACE}""",
    "sensor_msgs/msg/JointState": f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort{_HEADER}""",
    "sensor_msgs/msg/PointCloud2": f"""std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
================================================================================
MSG: sensor_msgs/PointField
string name
uint32 offset
uint8 datatype
uint32 count{_HEADER}""",
}


class Ros2(Sink):
    """Messages with the instants of measurement; the frame is the arm's."""

    lacks = "ids, labels and sessions of points"

    def __init__(self, file: IO[bytes], coordinates: Coordinates = "centre") -> None:
        from mcap_ros2.writer import Writer  # noqa: PLC0415 - extra `ros`

        super().__init__(file, coordinates)
        self._frame = "traverse_part" if coordinates == "part" else BASE_FRAME
        self._writer = Writer(file)
        self._schemas = {
            name: self._writer.register_msgdef(name, text)
            for name, text in DEFINITIONS.items()
        }

    def points(self, points: Sequence[Point]) -> None:
        """Write points, retractions left out by the caller."""
        self._check(points)
        self.n += len(points)
        for point in points:
            for message in point_messages(point, self._coordinates, self._frame):
                self._write(message)
            self._write(joint_states(point, frame=self._frame))

    def table(self, table: PointTable) -> None:
        """Write a piece of a scan as two clouds: good samples, and those in doubt."""
        self._count(table)
        for message in scan_messages(table, self._frame):
            self._write(message)

    def end(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]  # its library has few types

    def _write(self, message: RosMessage) -> None:
        if message.time_ns >= END_OF_TIME_NS:
            raise ValueError(
                f"a time of {message.time_ns * 1e-9:.0f} s UTC: those of ROS 2 end on "
                "19 January 2038; set the clock right, or export to another format"
            )
        self._writer.write_message(
            f"/traverse/{message.topic}",
            self._schemas[message.kind],
            message.content,
            log_time=message.time_ns,
            publish_time=message.time_ns,
            sequence=message.seq,
        )
