"""Contents of ROS 2 messages, in metres: what they say of points, poses and scans.

    point                  geometry_msgs/PointStamped
    point_with_covariance  geometry_msgs/PoseWithCovarianceStamped
    joint_states           sensor_msgs/JointState, readings
    scan                   sensor_msgs/PointCloud2
    /tf                    tf2_msgs/TFMessage, the frame of the ball

Messages have no place for a quality: what is in doubt has topics of its own, below
`doubtful/`, and a frame of its own.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from traverse.client.exports.point_table import Coordinates, PointTable, place_of
from traverse.kinematics.uncertainty.joint_covariance import covariances_of
from traverse.protocol.messages import Live, Point
from traverse.recording.views import turn_of_x_onto

BASE_FRAME, BALL_FRAME = "traverse_base", "traverse_ball"
M_PER_MM = 1e-3
FLOAT64, UINT32 = 8, 6  # of sensor_msgs/PointField
CLOUD_ROW = np.dtype(
    [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("quality", "<u4"), ("seq", "<u4")]
)
_FIELDS = [
    {
        "name": name,
        "offset": offset,
        "datatype": FLOAT64 if kind.kind == "f" else UINT32,
        "count": 1,
    }
    for name, (kind, offset, *_) in (CLOUD_ROW.fields or {}).items()
]
_NO_TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


@dataclass(frozen=True, slots=True)
class RosMessage:
    """A message as tables of its fields.

    Attributes:
        topic: below that of the arm, unless it begins with "/".
        kind: of the message, such as "sensor_msgs/msg/JointState".
        time_ns: instant of measurement. [UTC]
        content: by the names of fields; arrays of bytes are bytes.
        seq: number of a point; 0 where there is none.
    """

    topic: str
    kind: str
    time_ns: int
    content: Mapping[str, Any]
    seq: int = 0


def point_messages(
    point: Point, coordinates: Coordinates = "centre", frame: str = BASE_FRAME
) -> Iterator[RosMessage]:
    """Yield the place of a point, and with it its covariance where it is known.

    Raises:
        ValueError: it has no such coordinates.
    """
    below = _below(point)
    header = _header(point.time_ns, frame)
    position = _vector(place_of(point, coordinates))
    yield RosMessage(
        f"{below}point",
        "geometry_msgs/msg/PointStamped",
        point.time_ns,
        {"header": header, "point": position},
        point.seq,
    )
    if point.covariance_mm2 is not None and coordinates != "part":
        pose = {"position": position, "orientation": _NO_TURN}
        covariance = _covariance(point.covariance_mm2)
        yield RosMessage(
            f"{below}point_with_covariance",
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            point.time_ns,
            {"header": header, "pose": {"pose": pose, "covariance": covariance}},
            point.seq,
        )


def joint_states(
    sample: Point | Live, names: Sequence[str] = (), frame: str = BASE_FRAME
) -> RosMessage:
    """Return the readings of the joints."""
    content = {
        "header": _header(sample.time_ns, frame),
        "name": joint_names(names, len(sample.angles_rad)),
        "position": list(sample.angles_rad),
        "velocity": [],
        "effort": [],
    }
    seq = sample.seq if isinstance(sample, Point) else 0
    return RosMessage(
        f"{_below(sample)}joint_states",
        "sensor_msgs/msg/JointState",
        sample.time_ns,
        content,
        seq,
    )


def joint_names(names: Sequence[str], n_joints: int) -> list[str]:
    """Return the names of joints; J1, J2 and so on where they are not known."""
    if len(names) == n_joints:
        return list(names)
    return [f"J{number}" for number in range(1, n_joints + 1)]


def ball_transform(live: Live, frame: str = BASE_FRAME) -> RosMessage:
    """Return the frame of the ball; its x axis is the shank."""
    transform = {
        "header": _header(live.time_ns, frame),
        "child_frame_id": BALL_FRAME if live.quality.ok else f"{BALL_FRAME}_doubtful",
        "transform": {
            "translation": _vector(live.xyz_mm),
            "rotation": turn_of_x_onto(live.ijk),
        },
    }
    kind = "tf2_msgs/msg/TFMessage"
    return RosMessage("/tf", kind, live.time_ns, {"transforms": [transform]})


def scan_messages(table: PointTable, frame: str = BASE_FRAME) -> Iterator[RosMessage]:
    """Yield a piece of a scan as two clouds: good samples, and those in doubt."""
    for is_ok, topic in ((True, "scan"), (False, "doubtful/scan")):
        chosen = table.ok == is_ok
        if not chosen.any():
            continue
        rows = np.zeros(int(chosen.sum()), CLOUD_ROW)
        for column, axis in enumerate("xyz"):
            rows[axis] = M_PER_MM * table.xyz_mm[chosen, column]
        rows["quality"], rows["seq"] = table.quality[chosen], table.seq[chosen]
        first_ns = int(table.time_ns[chosen][0])
        cloud = {
            "header": _header(first_ns, frame),
            "height": 1,
            "width": len(rows),
            "fields": _FIELDS,
            "is_bigendian": False,
            "point_step": CLOUD_ROW.itemsize,
            "row_step": CLOUD_ROW.itemsize * len(rows),
            "data": rows.tobytes(),
            "is_dense": True,
        }
        yield RosMessage(topic, "sensor_msgs/msg/PointCloud2", first_ns, cloud)


def _below(sample: Point | Live) -> str:
    return "" if sample.quality.ok else "doubtful/"


def _header(time_ns: int, frame: str) -> dict[str, Any]:
    seconds, nanoseconds = divmod(time_ns, 10**9)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame}


def _vector(xyz_mm: Sequence[float]) -> dict[str, float]:
    return {axis: M_PER_MM * mm for axis, mm in zip("xyz", xyz_mm, strict=True)}


def _covariance(covariance_mm2: Sequence[float]) -> list[float]:
    """Return (6, 6) in rows [m^2]: the turn, which a ball does not have, is 0."""
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = covariances_of(np.array(covariance_mm2))
    result: list[float] = (M_PER_MM**2 * matrix).ravel().tolist()
    return result
