"""Public JSON schemas of Foxglove, those parts of them that are written here.

Names, types and required keys are those of https://github.com/foxglove/foxglove-sdk,
folder schemas/jsonschema (MIT licence). Viewers choose what to draw by the names.
"""

from typing import Any

Schema = dict[str, Any]

_NUMBER: Schema = {"type": "number"}
_TIME: Schema = {
    "type": "object",
    "title": "time",
    "properties": {
        "sec": {"type": "integer", "minimum": 0},
        "nsec": {"type": "integer", "minimum": 0, "maximum": 999_999_999},
    },
}


def _object(title: str, properties: dict[str, Schema]) -> Schema:
    return {
        "title": title,
        "type": "object",
        "properties": properties,
        "required": list(properties),
    }


def _numbers(title: str, names: str) -> Schema:
    return _object(title, dict.fromkeys(names, _NUMBER))


def _one_of(title: str, names: tuple[str, ...]) -> Schema:
    values = [{"title": name, "const": value} for value, name in enumerate(names)]
    return {"title": title, "oneOf": values}


_POSE = _object(
    "foxglove.Pose",
    {
        "position": _numbers("foxglove.Vector3", "xyz"),
        "orientation": _numbers("foxglove.Quaternion", "xyzw"),
    },
)
NUMERIC_TYPES = (
    "UNKNOWN",
    "UINT8",
    "INT8",
    "UINT16",
    "INT16",
    "UINT32",
    "INT32",
    "FLOAT32",
    "FLOAT64",
)
LOG_LEVELS = ("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")

POSE_IN_FRAME = _object(
    "foxglove.PoseInFrame",
    {"timestamp": _TIME, "frame_id": {"type": "string"}, "pose": _POSE},
)
POINT_CLOUD = _object(
    "foxglove.PointCloud",
    {
        "timestamp": _TIME,
        "frame_id": {"type": "string"},
        "pose": _POSE,
        "point_stride": {"type": "integer", "minimum": 0},
        "fields": {
            "type": "array",
            "items": _object(
                "foxglove.PackedElementField",
                {
                    "name": {"type": "string"},
                    "offset": {"type": "integer", "minimum": 0},
                    "type": _one_of("foxglove.NumericType", NUMERIC_TYPES),
                },
            ),
        },
        "data": {"type": "string", "contentEncoding": "base64"},
    },
)
LOG = _object(
    "foxglove.Log",
    {
        "timestamp": _TIME,
        "level": _one_of("foxglove.LogLevel", LOG_LEVELS),
        "message": {"type": "string"},
        "name": {"type": "string"},
        "file": {"type": "string"},
        "line": {"type": "integer", "minimum": 0},
    },
)
