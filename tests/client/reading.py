"""Reading a client's points within a time limit."""

import asyncio

from traverse.client import Arm, Lost
from traverse.protocol.messages import Point

PATIENCE_S = 30.0


async def read(arm: Arm, n: int) -> list[Point | Lost]:
    """The next points and losses, in the order in which they are handed out."""
    points: list[Point | Lost] = []
    async with asyncio.timeout(PATIENCE_S):
        while len(points) < n:
            points.append(await anext(arm.points_and_losses()))
    return points
