"""A scan of one's own: started, its blocks followed, ended."""

from collections.abc import Awaitable, Callable
from typing import Self

from traverse.client.feeds import Feed
from traverse.client.results import StartedScan
from traverse.protocol.messages import Scan


class ScanBlocks:
    """Blocks of a scan that runs while the `async with` does; use with `async for`.

    Iteration ends with the scan: at the end of the block, when another client stops it,
    or when another scan replaces it. A block that is repeated, as may be after an
    outage, is left out.

    Args:
        follow: subscribes to blocks of scans, and yields them.
        start, stop: the commands.

    Attributes:
        missing: points that did not arrive, by the gaps in their numbers.
    """

    def __init__(
        self,
        follow: Callable[[], Awaitable[Feed[Scan]]],
        start: Callable[[], Awaitable[StartedScan]],
        stop: Callable[[], Awaitable[None]],
    ) -> None:
        self._follow = follow
        self._start = start
        self._stop = stop
        self._feed: Feed[Scan] | None = None
        self._next_seq = 0
        self._has_ended = False
        self._scan: StartedScan | None = None
        self.missing = 0

    @property
    def scan(self) -> StartedScan:
        """The started scan."""
        if self._scan is None:
            raise RuntimeError("the scan has not begun; use it with `async with`")
        return self._scan

    async def __aenter__(self) -> Self:
        self._feed = await self._follow()
        self._scan = await self._start()
        return self

    async def __aexit__(self, *raised: object) -> None:
        self._feed = None
        if not self._has_ended:
            await self._stop()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Scan:
        if self._feed is None or self._has_ended:
            raise StopAsyncIteration
        async for block in self._feed:
            if block.scan != self.scan.scan:
                continue
            if block.seq < self._next_seq:
                continue
            self._has_ended = block.last
            self.missing += block.seq - self._next_seq
            self._next_seq = block.seq + len(block.dtime_ns)
            return block
        raise StopAsyncIteration
