"""Cost of storing each point on disk before it is published.

`python -m benchmarks.service.outbox [FOLDER]`: points handed to the outbox on an event
loop, with nothing else running, on the file system of FOLDER. One at a time: time until
the point is stored safely. Many in flight: points a second, with group commit.
"""

import asyncio
import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

from tests.protocol.message_examples import POINT
from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import OutboxSection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import latencies_by_name
from traverse.daemon.mqtt.message_publisher import MessagePublisher
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.points.capture import Session
from traverse.daemon.store.outbox import Outbox
from traverse.daemon.store.records import PendingPoint
from traverse.protocol.encoding import encode

N_ALONE = 200
RUN_S = 2.0
IN_FLIGHT = (1, 10, 100)
BAR_BYTES = 4096


class Rig:
    """An outbox, and a caller that takes points as `Capture` does."""

    def __init__(self, folder: Path) -> None:
        clock = HostClock()
        self.queue = OutgoingQueue()
        self.session = Session(time.time_ns())
        self.outbox = Outbox(
            folder / "outbox.db",
            MessagePublisher("bench-7", "msgpack", self.queue, clock),
            EventLog(clock, lambda occurrence: None),
            section=OutboxSection(),
            limit=1000,
            latencies=latencies_by_name(),
        )

    def take(self) -> PendingPoint:
        """A point on its way to the disk."""
        session = self.session
        point = POINT.model_copy(
            update={
                "session": session.id,
                "seq": session.next_seq,
                "id": session.next_id,
            }
        )
        keeping = self.outbox.put_point(point, session.begun_ns, session.note)
        if keeping is None:
            raise RuntimeError("the outbox has no room")
        session.add(point)
        keeping.on_roll_back(lambda: session.roll_back(point))
        return keeping

    async def safe(self, keeping: PendingPoint) -> None:
        """Wait until a point is on the disk."""
        done = asyncio.get_running_loop().create_future()
        keeping.on_settled(lambda: done.set_result(None))
        await done
        if keeping.trouble is not None:
            raise RuntimeError(keeping.trouble.text)
        while (sent := self.queue.next()) is not None:
            self.queue.done(*sent)


async def alone_ms(rig: Rig) -> list[float]:
    """Times of points that are taken one after the other [ms]."""
    times = []
    for _ in range(N_ALONE):
        begun_s = time.perf_counter()
        await rig.safe(rig.take())
        times.append((time.perf_counter() - begun_s) * 1e3)
    return sorted(times)


async def points_per_s(rig: Rig, in_flight: int) -> float:
    """Points that become safe in a second, with so many on their way."""
    begun_s, n = time.perf_counter(), 0

    async def worker() -> None:
        nonlocal n
        while time.perf_counter() - begun_s < RUN_S:
            await rig.safe(rig.take())
            n += 1

    await asyncio.gather(*(worker() for _ in range(in_flight)))
    return n / (time.perf_counter() - begun_s)


def encoding_ms() -> float:
    """The same work without a disk: a point is numbered and encoded."""
    times = []
    for k in range(N_ALONE):
        begun_s = time.perf_counter()
        point = POINT.model_copy(update={"seq": k})
        encode(point, "msgpack")
        times.append((time.perf_counter() - begun_s) * 1e3)
    return statistics.median(times)


def sync_ms(folder: Path) -> float:
    """The bar: one write of 4 KiB and its fdatasync."""
    times = []
    with (folder / "bar").open("wb", buffering=0) as file:
        for _ in range(N_ALONE):
            begun_s = time.perf_counter()
            file.write(bytes(BAR_BYTES))
            os.fdatasync(file.fileno())
            times.append((time.perf_counter() - begun_s) * 1e3)
    return statistics.median(times)


async def main(folder: Path) -> None:
    """Measure and print."""
    sys.stdout.write(f"load {os.getloadavg()[0]:.1f}\n")
    sys.stdout.write(f"no disk: numbered and encoded  {encoding_ms():.3f} ms\n")
    sys.stdout.write(f"bar: 4 KiB and fdatasync       {sync_ms(folder):.3f} ms\n")
    rig = Rig(folder)
    async with rig.outbox.running():
        times = await alone_ms(rig)
        sys.stdout.write(
            f"one point until it is safe     {statistics.median(times):.3f} ms, "
            f"99 % {times[int(0.99 * N_ALONE)]:.3f} ms, n = {N_ALONE}\n"
        )
        for in_flight in IN_FLIGHT:
            rate = await points_per_s(rig, in_flight)
            sys.stdout.write(f"{in_flight:4d} in flight: {rate:8.0f} points/s\n")


if __name__ == "__main__":
    within = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    with tempfile.TemporaryDirectory(dir=within) as name:
        asyncio.run(main(Path(name)))
