"""Scans that buttons start and stop; each takes a while, so they wait in a queue."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Literal

from traverse.daemon.errors import RequestRefusedError, Result
from traverse.daemon.monitoring.events import EventLog
from traverse.protocol.messages import ScanArgs

MAX_WAITING_ACTIONS = 64


class ButtonScans:
    """Executes actions one after the other, beside the edges.

    Args:
        events: where refused actions are reported.
    """

    def __init__(self, events: EventLog) -> None:
        self._events = events
        self._actions: asyncio.Queue[ScanArgs] = asyncio.Queue(MAX_WAITING_ACTIONS)

    def request(self, action: Literal["start", "stop"]) -> None:
        """Start a scan by time at the configured rate, or stop the running one."""
        try:
            self._actions.put_nowait(ScanArgs(action=action))
        except asyncio.QueueFull:
            self._refuse(
                f"{MAX_WAITING_ACTIONS} presses wait for scans to start and to stop",
                "wait until the last scan has started",
            )

    async def run(self, change_scan: Callable[[ScanArgs], Awaitable[Result]]) -> None:
        """Execute what is requested until cancelled, as the command `scan` does."""
        while True:
            args = await self._actions.get()
            try:
                await change_scan(args)
            except RequestRefusedError as error:
                self._refuse(str(error), error.remedy)

    def _refuse(self, text: str, remedy: str) -> None:
        self._events.report("error", "scan.refused", text, source="scan", remedy=remedy)
