"""Waiting for what another thread, program or computer does."""

import asyncio
import time
from collections.abc import Callable

PATIENCE_S = 20.0
LOOK_S = 0.005


async def until(
    condition: Callable[[], object], what: str = "", timeout_s: float = PATIENCE_S
) -> None:
    """Let the loop run until a condition holds; fail with ``what`` if it never does."""
    end_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end_s:
            raise AssertionError(f"not within {timeout_s:g} s: {what}")
        await asyncio.sleep(LOOK_S)
