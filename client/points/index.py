"""The latest points, found by their names: for who has just taken one."""

import asyncio
from collections import OrderedDict

from traverse.protocol.messages import Point

MAX_REMEMBERED = 256


class PointIndex:
    """The latest received points, by their names."""

    def __init__(self) -> None:
        self._latest: OrderedDict[str, Point] = OrderedDict()
        self._waiting: dict[str, asyncio.Future[Point]] = {}

    def take(self, point: Point) -> None:
        """A point was received."""
        self._latest[point.id] = point
        if len(self._latest) > MAX_REMEMBERED:
            self._latest.popitem(last=False)
        waiting = self._waiting.get(point.id)
        if waiting is not None and not waiting.done():
            waiting.set_result(point)

    async def get(self, point_id: str, seconds: float) -> Point | None:
        """A point that has arrived, or arrives within this time."""
        if point_id in self._latest:
            return self._latest[point_id]
        future: asyncio.Future[Point] = asyncio.get_running_loop().create_future()
        self._waiting[point_id] = future
        try:
            await asyncio.wait({future}, timeout=seconds)
            return future.result() if future.done() else None
        finally:
            future.cancel()
            del self._waiting[point_id]
