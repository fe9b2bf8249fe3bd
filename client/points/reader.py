"""Points alone, for who does not want to see losses among them."""

from typing import Self

from traverse.client.points.stream import PointStream
from traverse.protocol.messages import Point


class Points:
    """The points of a stream; what is lost is logged and counted."""

    def __init__(self, stream: PointStream) -> None:
        self._stream = stream

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Point:
        while True:
            item = await anext(self._stream)
            if isinstance(item, Point):
                return item
