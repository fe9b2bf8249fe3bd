import asyncio
import os
import threading

from traverse.drivers.base import driver as driver_module
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.driver import CONNECT_S, Driver, DriverOptions


class Deaf(Driver):
    def __init__(self, delivery_queue: DeliveryQueue, clock) -> None:
        super().__init__("base", DriverOptions(), delivery_queue, monotonic_ns=clock)
        self.serving, self.let_go = threading.Event(), threading.Event()

    def request_stream(self, rate_hz: float) -> None:
        """Do nothing: it has no stream."""

    def _connect(self) -> None:
        self.let_go.wait()
        self.let_go.clear()

    def _serve(self) -> None:
        self._report_counters()
        self.serving.set()
        self.let_go.wait()

    def _disconnect(self) -> None:
        """Nothing is open."""


async def test_a_stuck_reader_is_overdue_and_is_left_behind_at_the_end(
    monkeypatch, caplog
):
    monkeypatch.setattr(driver_module, "CLOSE_S", 0.05)
    now_ns = 10**12

    def clock() -> int:
        return now_ns

    deaf = Deaf(DeliveryQueue(asyncio.get_running_loop()), clock)
    assert deaf.heartbeat.overdue_s(1.0) is None  # it has not begun
    deaf.start()
    while deaf.heartbeat._last_beat is None:  # noqa: ASYNC110 - another thread's doing
        await asyncio.sleep(0.001)
    now_ns += int(CONNECT_S * 1e9)
    assert deaf.heartbeat.overdue_s(1.0) is None  # connecting may take long
    deaf.let_go.set()
    assert await asyncio.to_thread(deaf.serving.wait, 10)
    now_ns += 10**9
    assert deaf.heartbeat.overdue_s(1.0) is None
    now_ns += 1
    assert deaf.heartbeat.overdue_s(1.0) == (10**9 + 1) / 1e9

    await asyncio.to_thread(deaf.close)
    assert deaf.thread.is_alive()
    assert deaf.thread.daemon
    assert "the reader of base is stuck" in caplog.text
    deaf.let_go.set()
    deaf.thread.join(10)
    assert deaf.heartbeat.overdue_s(0.0) is None  # it has ended in order
    for number in (deaf._wake_read, deaf._wake_write):
        os.close(number)  # they were left to the end of the program
