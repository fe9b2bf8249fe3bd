"""What buttons do besides points: scans, which take a while to begin and to end."""

import asyncio
from collections.abc import Awaitable, Callable

from traverse.daemon.errors import RequestRefusedError, Result
from traverse.daemon.monitoring.events import EventLog
from traverse.protocol.messages import ScanArgs


class ButtonScans:
    """Carries actions out one after the other, beside the edges.

    Args:
        change_scan: starts and stops scans, as the command does.
        events: where it is told what was refused.
    """

    def __init__(
        self, change_scan: Callable[[ScanArgs], Awaitable[Result]], events: EventLog
    ) -> None:
        self._change_scan = change_scan
        self._events = events
        self._turn = asyncio.Lock()  # first come, first served
        self._tasks: set[asyncio.Task[None]] = set()

    def start_scan(self) -> None:
        """Start a scan by time, at the configured rate."""
        self._do(ScanArgs(action="start"))

    def stop_scan(self) -> None:
        """Stop the running scan."""
        self._do(ScanArgs(action="stop"))

    async def done(self) -> None:
        """Wait for all that has been begun."""
        await asyncio.gather(*self._tasks)

    def _do(self, args: ScanArgs) -> None:
        task = asyncio.create_task(self._carry_out(args))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _carry_out(self, args: ScanArgs) -> None:
        async with self._turn:
            try:
                await self._change_scan(args)
            except RequestRefusedError as error:
                self._events.report(
                    "error",
                    "scan.refused",
                    str(error),
                    source="scan",
                    remedy=error.remedy,
                )
