"""Points as files, for the page's buttons."""

from protocol.encoding import encode
from protocol.messages import Point


def points_as(kind: str, points: list[Point]) -> tuple[str, bytes]:
    """Name and content of a file of some kind."""
    lines = [encode(point, "json") for point in points]
    return f"points.{kind}", b"\n".join([*lines, b""])
