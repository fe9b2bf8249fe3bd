"""Reading a client's points within a time limit."""

import asyncio
from collections.abc import Callable

from traverse.client import Arm, Lost
from traverse.protocol.messages import Point

PATIENCE_S = 30.0


async def read(arm: Arm, n: int) -> list[Point | Lost]:
    """The next points and losses, in the order in which they are handed out."""
    found: list[Point | Lost] = []
    async with asyncio.timeout(PATIENCE_S):
        while len(found) < n:
            found.append(await anext(arm.points_and_losses()))
    return found


async def until(condition: Callable[[], bool]) -> None:
    """Let the loop run until a condition holds."""
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - no event reports it
            await asyncio.sleep(0.005)
