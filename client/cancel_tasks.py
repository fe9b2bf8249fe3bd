"""Tasks that run together, cancelled reliably."""

import asyncio
from collections.abc import Coroutine, Iterable
from typing import Any

AGAIN_S = 0.5


async def run_together(*work: Coroutine[Any, Any, None]) -> None:
    """Run all until they end, or one fails; cancel the others."""
    tasks = [asyncio.create_task(coroutine) for coroutine in work]
    try:
        await asyncio.gather(*tasks)
    finally:
        await cancel_tasks(tasks)


async def run_until_first(*work: Coroutine[Any, Any, None]) -> None:
    """Run all until one of them ends, or fails; cancel the others."""
    tasks = [asyncio.create_task(coroutine) for coroutine in work]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        await cancel_tasks(tasks)


async def cancel_tasks(tasks: Iterable[asyncio.Task[Any]]) -> None:
    """Cancel tasks and wait for their end.

    Repeated if necessary: up to Python 3.11 `asyncio.wait_for` loses a cancellation
    that arrives as its work is done.
    """
    left = set(tasks)
    while left:
        for task in left:
            task.cancel()
        _, left = await asyncio.wait(left, timeout=AGAIN_S)
