"""Points and scans as ROS 2 messages in an MCAP file, in metres, without ROS.

    /traverse/point                  geometry_msgs/PointStamped
    /traverse/point_with_covariance  geometry_msgs/PoseWithCovarianceStamped
    /traverse/joint_states           sensor_msgs/JointState, the readings of each point
    /traverse/scan                   sensor_msgs/PointCloud2

Messages have no place for a quality: what is in doubt has topics of its own, below
/traverse/doubtful. Definitions are from ROS 2's common interfaces.
"""

from collections.abc import Mapping, Sequence
from typing import IO, Any

import numpy as np

from traverse.client.exports.point_table import Coordinates, PointTable, Sink, place_of
from traverse.protocol.messages import Point

M_PER_MM = 1e-3
FLOAT64, UINT32 = 8, 6  # of sensor_msgs/PointField
CLOUD_ROW = np.dtype(
    [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("quality", "<u4"), ("seq", "<u4")]
)
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
        self._frame = "traverse_part" if coordinates == "part" else "traverse_base"
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
            below = "" if point.quality.ok else "doubtful/"
            position = _position(place_of(point, self._coordinates))
            self._write(
                f"{below}point",
                "geometry_msgs/msg/PointStamped",
                point.time_ns,
                {"point": position},
                point.seq,
            )
            if point.covariance_mm2 is not None and self._coordinates != "part":
                covariance = _covariance(point.covariance_mm2)
                pose = {"position": position, "orientation": _NO_TURN}
                self._write(
                    f"{below}point_with_covariance",
                    "geometry_msgs/msg/PoseWithCovarianceStamped",
                    point.time_ns,
                    {"pose": {"pose": pose, "covariance": covariance}},
                    point.seq,
                )
            names = [f"J{k + 1}" for k in range(len(point.angles_rad))]
            joints = {"name": names, "position": list(point.angles_rad)}
            self._write(
                f"{below}joint_states",
                "sensor_msgs/msg/JointState",
                point.time_ns,
                {**joints, "velocity": [], "effort": []},
                point.seq,
            )

    def table(self, table: PointTable) -> None:
        """Write a piece of a scan as two clouds: good samples, and those in doubt."""
        self._count(table)
        for is_ok, topic in ((True, "scan"), (False, "doubtful/scan")):
            chosen = table.ok == is_ok
            if not chosen.any():
                continue
            rows = np.zeros(int(chosen.sum()), CLOUD_ROW)
            for column, axis in enumerate("xyz"):
                rows[axis] = M_PER_MM * table.xyz_mm[chosen, column]
            rows["quality"], rows["seq"] = table.quality[chosen], table.seq[chosen]
            cloud = {
                "height": 1,
                "width": len(rows),
                "fields": _FIELDS,
                "is_bigendian": False,
                "point_step": CLOUD_ROW.itemsize,
                "row_step": CLOUD_ROW.itemsize * len(rows),
                "data": rows.tobytes(),
                "is_dense": True,
            }
            first_ns = int(table.time_ns[chosen][0])
            self._write(topic, "sensor_msgs/msg/PointCloud2", first_ns, cloud, 0)

    def end(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]  # its library has few types

    def _write(
        self,
        topic: str,
        kind: str,
        time_ns: int,
        content: Mapping[str, Any],
        sequence: int,
    ) -> None:
        seconds, nanoseconds = divmod(time_ns, 10**9)
        stamp = {"sec": seconds, "nanosec": nanoseconds}
        header = {"stamp": stamp, "frame_id": self._frame}
        self._writer.write_message(
            f"/traverse/{topic}",
            self._schemas[kind],
            {"header": header, **content},
            log_time=time_ns,
            publish_time=time_ns,
            sequence=sequence,
        )


_NO_TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_FIELDS = [
    {
        "name": name,
        "offset": offset,
        "datatype": FLOAT64 if kind.kind == "f" else UINT32,
        "count": 1,
    }
    for name, (kind, offset, *_) in (CLOUD_ROW.fields or {}).items()
]


def _position(place_mm: Sequence[float]) -> dict[str, float]:
    return {axis: M_PER_MM * mm for axis, mm in zip("xyz", place_mm, strict=True)}


def _covariance(covariance_mm2: Sequence[float]) -> list[float]:
    """Return (6, 6) in rows [m^2]: the turn, which a ball does not have, is 0."""
    matrix = np.zeros((6, 6))
    rows, columns = np.triu_indices(3)
    matrix[rows, columns] = matrix[columns, rows] = covariance_mm2
    result: list[float] = (M_PER_MM**2 * matrix).ravel().tolist()
    return result
