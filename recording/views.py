"""Messages for viewers: points, scans and events, in Foxglove's public schemas.

Viewers take lengths as metres. A scan's cloud has the coordinates once more, in
millimetres and to the last bit, since a recording is compared by them.

Names, types and required keys in the folder `schemas`, as far as they are written
there, are those of https://github.com/foxglove/foxglove-sdk, folder schemas/jsonschema
(MIT licence). Viewers choose what to draw by the names.
"""

import base64
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Floats
from traverse.protocol.messages import Event, Point, Scan
from traverse.protocol.messages.later_doubt import LaterDoubt
from traverse.protocol.messages.scan import ScanMode

FRAME = "arm"
UINT32, FLOAT32, FLOAT64 = 5, 7, 8  # foxglove.NumericType
_TYPES = {FLOAT32: "<f4", FLOAT64: "<f8", UINT32: "<u4"}
COVARIANCES = tuple(f"{axes}_mm2" for axes in ("xx", "xy", "xz", "yy", "yz", "zz"))
CLOUD_FIELDS = (
    *((name, FLOAT32) for name in "xyz"),
    *((name, FLOAT64) for name in ("x_mm", "y_mm", "z_mm", "i", "j", "k")),
    ("number", UINT32),
    ("quality", UINT32),
    ("after_s", FLOAT64),
    *((name, FLOAT64) for name in COVARIANCES),
)
"""Fields of a cloud's point: name and type, packed without gaps."""
CLOUD_TYPE = np.dtype([(name, _TYPES[kind]) for name, kind in CLOUD_FIELDS])
_NO_TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_INFO, _WARNING, _ERROR = 2, 3, 4  # foxglove.LogLevel
_LEVELS = {"info": _INFO, "warning": _WARNING}

_SCHEMAS = Path(__file__).with_name("schemas")
VIEW_SCHEMAS: dict[str, dict[str, Any]] = {
    topic: json.loads((_SCHEMAS / f"{topic}.schema.json").read_bytes())
    for topic in ("pose", "cloud", "log", "point")
}
"""Schemas of the channels for viewers, by topic; that of points by `make schemas`."""
VIEW_NAMES = {
    topic: "traverse/point/1" if topic == "point" else str(schema["title"])
    for topic, schema in VIEW_SCHEMAS.items()
}


def point_to_bytes(point: Point) -> bytes:
    """Write a point whole, as JSON: numbers keep their last bit."""
    return point.model_dump_json().encode()


def pose_to_bytes(point: Point) -> bytes:
    """Write the pose of a point; its x axis is the shank, from wrist to ball."""
    x, y, z = (value * 1e-3 for value in point.xyz_mm)
    table = {
        "timestamp": _time(point.time_ns),
        "frame_id": FRAME,
        "pose": {
            "position": {"x": x, "y": y, "z": z},
            "orientation": turn_of_x_onto(point.ijk),
        },
        "message_id": point.id,
    }
    return json.dumps(table).encode()


def cloud_to_bytes(scan: Scan) -> bytes:
    n = len(scan.xyz_mm)
    packed = np.zeros(n, CLOUD_TYPE)
    for column, axis in enumerate("xyz"):
        packed[axis] = scan.xyz_mm[:, column] * 1e-3
        packed[f"{axis}_mm"] = scan.xyz_mm[:, column]
    for column, axis in enumerate("ijk"):
        packed[axis] = scan.ijk[:, column]
    packed["number"] = np.arange(scan.seq, scan.seq + n)
    packed["quality"] = scan.quality
    packed["after_s"] = np.asarray(scan.dtime_ns) * 1e-9
    covariance_mm2 = scan.covariance_mm2
    for column, name in enumerate(COVARIANCES):
        packed[name] = np.nan if covariance_mm2 is None else covariance_mm2[:, column]
    fields = [
        {"name": name, "offset": CLOUD_TYPE.fields[name][1], "type": kind}  # type: ignore[index] # it has names
        for name, kind in CLOUD_FIELDS
    ]
    table = {
        "timestamp": _time(scan.time_ns),
        "frame_id": FRAME,
        "pose": {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": _NO_TURN},
        "point_stride": CLOUD_TYPE.itemsize,
        "fields": fields,
        "data": base64.b64encode(packed.tobytes()).decode(),
        "scan": scan.scan,
        "session": scan.session,
        "time_ns": str(scan.time_ns),
        "mode": scan.mode,
        "arm": scan.arm,
        "model": scan.model,
        "probe_radius_mm": scan.probe_radius_mm,
        "angles_rad": scan.angles_rad[[0, -1]].tolist() if n else [],
    }
    return json.dumps(table).encode()


def columns_of(points: NDArray[np.void], names: Iterable[str]) -> Floats:
    """Return fields of a cloud's points as columns, (n, n_names)."""
    return np.stack([points[name] for name in names], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Block of a scan's points.

    Attributes:
        time_ns: instant that `after_s` counts from. [UTC]
        mode, arm, model, probe_radius_mm: as of `Scan`; "time", empty and NaN where
            they were not recorded.
        ends_rad: angles of the first and the last point, (2, n_joints); or (2, 0).
    """

    session: str
    scan: str
    time_ns: int
    points: NDArray[np.void]
    mode: ScanMode
    arm: str
    model: str
    probe_radius_mm: float
    ends_rad: Floats


def bytes_to_cloud(content: bytes) -> Cloud:
    """Read a cloud that was written here.

    Raises:
        ValueError: It is not such a cloud.
    """
    try:
        table = json.loads(content)
        names = [field["name"] for field in table["fields"]]
        if names != [name for name, _ in CLOUD_FIELDS]:
            raise ValueError(f"fields {', '.join(names)} are of another version")
        data = base64.b64decode(table["data"], validate=True)
        points = np.frombuffer(data, CLOUD_TYPE)
        session, scan = str(table["session"]), str(table["scan"])
        return Cloud(
            session,
            scan,
            int(table["time_ns"]),
            points,
            table.get("mode", "time"),
            str(table.get("arm", "")),
            str(table.get("model", "")),
            float(table.get("probe_radius_mm", np.nan)),
            np.array(table.get("angles_rad", []), dtype=np.float64).reshape(2, -1),
        )
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"no cloud of a scan: {error!r}") from error


def log_to_bytes(event: Event) -> bytes:
    """Write an event; its code is in the place of a file's name, its data are kept."""
    remedy = f"; {event.remedy}" if event.remedy else ""
    times = f" ({event.count} times)" if event.count > 1 else ""
    table = {
        "timestamp": _time(event.last_ns),
        "level": _LEVELS.get(event.severity, _ERROR),
        "message": f"{event.code}: {event.text}{times}{remedy}",
        "name": event.source,
        "file": event.code,
        "line": 0,
        "data": event.data,
    }
    return json.dumps(table).encode()


def bytes_to_doubt(content: bytes) -> LaterDoubt | None:
    """Read what an event that was written here puts in doubt; None if nothing.

    Raises:
        ValueError: It is not such an event.
    """
    try:
        return LaterDoubt.of(json.loads(content).get("data", {}))
    except (AttributeError, TypeError, ValueError) as error:
        raise ValueError(f"no event: {error!r}") from error


def _time(utc_ns: int) -> dict[str, int]:
    return {"sec": utc_ns // 10**9, "nsec": utc_ns % 10**9}


def turn_of_x_onto(direction: tuple[float, float, float]) -> dict[str, float]:
    """Return the shortest turn of the x axis onto a unit vector, as a quaternion."""
    i, j, k = direction
    if i < -1.0 + 1e-12:  # half a turn, about any axis across
        return {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}
    w = float(np.sqrt(0.5 * (1.0 + i)))
    return {"x": 0.0, "y": -0.5 * k / w, "z": 0.5 * j / w, "w": w}
