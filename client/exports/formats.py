"""All formats by name."""

import io
from collections.abc import Sequence

from traverse.client.exports.binary import Numpy, Parquet, Ply
from traverse.client.exports.dxf import Dxf
from traverse.client.exports.point_table import Coordinates, Sink, standing
from traverse.client.exports.qif import Qif
from traverse.client.exports.text import Csv, JsonLines, Template, Xyz
from traverse.protocol.messages import Point

FORMATS: dict[str, type[Sink]] = {
    "csv": Csv,
    "dxf": Dxf,
    "jsonl": JsonLines,
    "npz": Numpy,
    "parquet": Parquet,
    "ply": Ply,
    "qif": Qif,
    "text": Template,
    "xyz": Xyz,
}


def points_as(
    kind: str, points: Sequence[Point], coordinates: Coordinates = "centre"
) -> tuple[str, bytes]:
    """Return name and content of a file with points that are not retracted."""
    file = io.BytesIO()
    with FORMATS[kind](file, coordinates) as sink:
        sink.points(standing(points))
    return f"points.{kind}", file.getvalue()
