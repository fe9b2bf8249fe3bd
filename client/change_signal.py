"""A signal that wakes all who wait."""

import asyncio


class ChangeSignal:
    """Each waiting task is woken by the next call of `notify`."""

    def __init__(self) -> None:
        self._waiting: set[asyncio.Future[None]] = set()
        self.beats = 0

    def notify(self) -> None:
        self.beats += 1
        if not self._waiting:
            return
        waiting, self._waiting = self._waiting, set()
        for future in waiting:
            if not future.done():
                future.set_result(None)

    async def wait(self, seconds: float | None = None) -> bool:
        future = asyncio.get_running_loop().create_future()
        self._waiting.add(future)
        try:
            if seconds is None:
                await future
            else:
                await asyncio.wait({future}, timeout=seconds)
            return future.done()
        finally:
            self._waiting.discard(future)
            future.cancel()
