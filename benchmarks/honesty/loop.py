"""An asyncio event loop in the time of a world."""

import asyncio
import selectors

from benchmarks.honesty.hub import Hub


class _Selector(selectors.SelectSelector):
    """Waiting lets the world run; no descriptor is polled."""

    def __init__(self, hub: Hub) -> None:
        super().__init__()
        self._hub = hub

    def select(
        self, timeout: float | None = None
    ) -> list[tuple[selectors.SelectorKey, int]]:
        """Let the world run until the loop is woken, or so long."""
        self._hub.run(timeout)
        return []


class VirtualLoop(asyncio.SelectorEventLoop):
    """The daemon's event loop."""

    def __init__(self, hub: Hub) -> None:
        super().__init__(_Selector(hub))
        self._hub = hub

    def time(self) -> float:
        return self._hub.loop_s

    def _write_to_self(self) -> None:
        self._hub.loop_woken = True
