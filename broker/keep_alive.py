"""Ping a silent connection, and end it if nothing is received."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

from traverse.broker.errors import MqttError
from traverse.broker.packets import PINGREQ


@dataclass(eq=False)
class KeepAlive:
    """Ping a broker once a period.

    Args:
        write: sends bytes.
        end: ends the connection with a reason.

    Attributes:
        is_heard: to be set whenever bytes have been received.
    """

    write: Callable[[bytes], None]
    end: Callable[[MqttError], None]
    is_heard: bool = True
    _timer: asyncio.TimerHandle | None = field(default=None, init=False)

    def start(self, period_s: float) -> None:
        self._timer = asyncio.get_running_loop().call_later(
            period_s, self._check, period_s
        )

    def stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _check(self, period_s: float) -> None:
        if not self.is_heard:
            self.end(MqttError(f"nothing was received for {period_s:g} s"))
            return
        self.is_heard = False
        self.write(PINGREQ)
        self.start(period_s)
