"""All formats by name."""

import io
from collections.abc import Sequence

from traverse.client.exports.binary import Numpy, Parquet, Ply
from traverse.client.exports.dxf import Dxf
from traverse.client.exports.point_table import Coordinates, Sink, standing
from traverse.client.exports.qif import Qif
from traverse.client.exports.ros import Ros2
from traverse.client.exports.text import Csv, JsonLines, Template, Xyz
from traverse.extensions import (
    EXPORT_GROUP,
    load_extension_class,
    offered_extensions,
)
from traverse.protocol.messages import Point

FORMATS: dict[str, type[Sink]] = {
    "csv": Csv,
    "dxf": Dxf,
    "jsonl": JsonLines,
    "npz": Numpy,
    "parquet": Parquet,
    "ply": Ply,
    "qif": Qif,
    "ros2": Ros2,
    "text": Template,
    "xyz": Xyz,
}


def format_class(name: str) -> type[Sink]:
    """Return the class that writes a format.

    Raises:
        KeyError: there is no such format.
        BrokenExtensionError: another package offers it, and it cannot be used.
    """
    built_in = FORMATS.get(name)
    if built_in is not None:
        return built_in
    return load_extension_class(EXPORT_GROUP, name, Sink)  # type: ignore[type-abstract]  # it loads a child


def format_names() -> tuple[str, ...]:
    return tuple(dict.fromkeys((*FORMATS, *offered_extensions(EXPORT_GROUP))))


def points_as(
    kind: str, points: Sequence[Point], coordinates: Coordinates = "centre"
) -> tuple[str, bytes]:
    """Return name and content of a file with points that are not retracted."""
    file = io.BytesIO()
    with format_class(kind)(file, coordinates) as sink:
        sink.points(standing(points))
    return f"points.{kind}", file.getvalue()
