"""Blocks of scans on their way to the disk, in order."""

import asyncio
from collections import deque

from traverse.daemon.store.records import Entry


class PendingBlocks:
    """Of one spool.

    Attributes:
        n_bytes: of their messages.
    """

    def __init__(self) -> None:
        self._blocks: deque[tuple[Entry, int]] = deque()
        self._changed = asyncio.Event()
        self.n_bytes = 0

    def __len__(self) -> int:
        return len(self._blocks)

    def add(self, entry: Entry, n_points: int) -> None:
        """A block of so many points is on its way."""
        self._blocks.append((entry, n_points))
        self.n_bytes += len(entry.payload)

    def take(self, n: int) -> list[Entry]:
        """The first ``n`` are on the disk: gives them."""
        return [entry for entry, _ in self._taken(n)]

    def give_up(self) -> list[tuple[Entry, int]]:
        """None will get there: gives them, with their numbers of points."""
        return self._taken(len(self._blocks))

    async def wait_empty(self) -> None:
        """Wait until no block is on its way."""
        while self._blocks:
            self._changed.clear()
            await self._changed.wait()

    def _taken(self, n: int) -> list[tuple[Entry, int]]:
        taken = [self._blocks.popleft() for _ in range(n)]
        self.n_bytes -= sum(len(entry.payload) for entry, _ in taken)
        self._changed.set()
        return taken
