"""Deliveries of a driver, and waiting for more."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import CountSamples, Delivery

__all__ = ["Deliveries"]

LIMIT_S = 20.0

Kind = TypeVar("Kind")


class Deliveries:
    """Deliveries of one delivery_queue, in order."""

    def __init__(self, delivery_queue: DeliveryQueue) -> None:
        self._delivery_queue = delivery_queue
        self.all: list[Delivery] = []

    def of(self, kind: type[Kind]) -> list[Kind]:
        return [delivery for delivery in self.all if isinstance(delivery, kind)]

    def seqs(self) -> list[int]:
        blocks = [block for block in self.all if isinstance(block, CountSamples)]
        return [int(seq) for block in blocks for seq in block.seq]

    async def until(self, condition: Callable[[], object], awaited: str) -> None:
        try:
            async with asyncio.timeout(LIMIT_S):
                while not condition():
                    self.all += await self._delivery_queue.take()
        except TimeoutError:
            raise AssertionError(
                f"not delivered within {LIMIT_S} s: {awaited}; there came {self.all}"
            ) from None
