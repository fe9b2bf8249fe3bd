"""Waiting for another thread, program or computer."""

import asyncio
import time
from collections.abc import Callable

PATIENCE_S = 20.0
LOOK_S = 0.005


async def until(
    condition: Callable[[], object], awaited: str = "", timeout_s: float = PATIENCE_S
) -> None:
    """Run the loop until a condition holds; fail with ``awaited`` if it never does."""
    end_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end_s:
            raise AssertionError(f"not within {timeout_s:g} s: {awaited}")
        await asyncio.sleep(LOOK_S)
