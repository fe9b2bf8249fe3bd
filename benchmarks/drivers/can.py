"""CANopen at 1 kHz: the driver's fast path beside the callbacks of the library.

Seven encoders answer every SYNC on a virtual bus in this process. The driver sends the
SYNCs and gathers its samples; a network of the `canopen` library listens to the same
frames with a callback for each PDO. Each has a thread of its own, whose time on a core
is measured by the kernel; the encoders run in a third.
"""

import asyncio
import logging
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import can
import canopen
import numpy as np
from can.interfaces.virtual import channels
from canopen.objectdictionary import ODRecord, ODVariable, datatypes

from benchmarks.tools.command_line import run_main
from benchmarks.tools.sizes import sized
from tests.drivers.canopen.fake_nodes import FakeNodes, u32
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import (
    STATUS_MISSING,
    CountSamples,
    DeviceFault,
    DeviceUp,
    StreamStarted,
)
from traverse.drivers.canopen.driver import CanOpenDriver
from traverse.drivers.canopen.options import CanOpenOptions
from traverse.drivers.canopen.sync_cycles import SyncCycleAssembler

NODES = (1, 2, 3, 4, 5, 6, 7)
RATE_HZ = 1000.0
SECONDS = sized(60.0, 1.0)
CHANNEL = "bench"


class CheapNodes(FakeNodes):
    """Encoders that put one frame into all queues of the bus, without copies."""

    def latch(self, lost: bool = False) -> None:
        del lost
        self.put([(0x180 + n.number, u32(n.count)) for n in self.nodes.values()])
        for node in self.nodes.values():
            node.count += 1

    def put(self, frames: list[tuple[int, bytes]]) -> None:
        own_queue = getattr(self._bus, "queue", None)  # of python-can's virtual bus
        receivers = [queue for queue in channels[CHANNEL] if queue is not own_queue]
        for can_id, data in frames:
            message = can.Message(time.time(), can_id, False)
            message.data, message.dlc = bytearray(data), len(data)
            for queue in receivers:
                queue.put(message)


class Master(threading.Thread):
    """Sends the SYNCs in the place of the kernel; none is left out."""

    def __init__(self, nodes: CheapNodes) -> None:
        super().__init__(name="master")
        self._nodes = nodes
        self.stopped = False

    def run(self) -> None:
        begun_s, n = time.monotonic(), 0
        while not self.stopped:
            n += 1
            time.sleep(max(0.0, begun_s + n / RATE_HZ - time.monotonic()))
            self._nodes.put([(0x080, b"")])
            self._nodes.latch()


def dictionary() -> canopen.ObjectDictionary:
    """Return the part of an object dictionary that the library needs."""
    objects = canopen.ObjectDictionary()
    for index, names in (
        (0x1800, [("cob", 1, datatypes.UNSIGNED32), ("type", 2, datatypes.UNSIGNED8)]),
        (0x1A00, [("n", 0, datatypes.UNSIGNED8), ("first", 1, datatypes.UNSIGNED32)]),
    ):
        record = ODRecord(f"{index:04X}", index)
        for name, sub, kind in names:
            variable = ODVariable(name, index, sub)
            variable.data_type = kind
            record.add_member(variable)
        objects.add_object(record)
    position = ODVariable("position", 0x6004)
    position.data_type = datatypes.UNSIGNED32
    objects.add_object(position)
    return objects


class LibraryReader:
    """Positions by the library's PDO callbacks."""

    def __init__(self) -> None:
        self.latest = dict.fromkeys(NODES, 0)
        self.n_frames = 0
        self.network = canopen.Network(can.Bus(CHANNEL, "virtual", ignore_config=True))
        for number in NODES:
            node = canopen.RemoteNode(number, dictionary())
            self.network.add_node(node)
            pdo = node.tpdo[1]
            pdo.cob_id, pdo.enabled, pdo.trans_type = 0x180 + number, True, 1
            pdo.add_variable(0x6004)
            pdo.add_callback(self.taker(number))
            pdo.subscribe()
        self.network.connect()

    def taker(self, number: int) -> Callable[[Any], None]:
        def take(pdo: Any) -> None:  # noqa: ANN401 - the library's map of a PDO
            self.latest[number] = pdo[0].raw
            self.n_frames += 1

        return take


def busy_s(thread: threading.Thread) -> float:
    """How long a thread has been on a core."""
    path = Path(f"/proc/self/task/{thread.native_id}/schedstat")
    return int(path.read_text().split()[0]) * 1e-9


def thread_named(part: str) -> threading.Thread:
    return next(t for t in threading.enumerate() if part in t.name)


async def measure(seconds: float, sync: Literal["host", "external"]) -> list[str]:
    delivery_queue = DeliveryQueue(asyncio.get_running_loop())
    driver = CanOpenDriver(
        "arm",
        CanOpenOptions(channel=CHANNEL, interface="virtual", nodes=NODES, sync=sync),
        delivery_queue,
    )
    deliveries: list[object] = []
    nodes = CheapNodes(CHANNEL, NODES)
    with nodes, driver:
        nodes.answers_sync = sync == "host"
        while not any(isinstance(d, DeviceUp) for d in deliveries):
            deliveries += await delivery_queue.take()
        library = LibraryReader()
        ours, theirs = thread_named("driver-arm"), thread_named("Notifier")
        start = busy_s(ours), busy_s(theirs), time.monotonic()
        driver.request_stream(RATE_HZ)
        master = Master(nodes)
        while not any(isinstance(d, StreamStarted) for d in deliveries):
            deliveries += await delivery_queue.take()
        await asyncio.sleep(0.1)
        if sync == "external":
            master.start()
        while time.monotonic() - start[2] < seconds:
            deliveries += await delivery_queue.take()
        elapsed_s = time.monotonic() - start[2]
        ours_s, theirs_s = busy_s(ours) - start[0], busy_s(theirs) - start[1]
        master.stopped = True
        await asyncio.sleep(0.2)
        driver.request_stream(0.0)
        await asyncio.sleep(0.2)
        n_library = library.n_frames
        library.network.disconnect()
    deliveries += delivery_queue.take_waiting()  # if there is anything left
    return [
        f"CANopen, {len(NODES)} nodes, SYNC at {RATE_HZ:g} Hz by "
        f"{'the driver' if sync == 'host' else 'another, as by the kernel'}, "
        f"{elapsed_s:.0f} s on a virtual bus:",
        f"  {stream_line(deliveries)}",
        f"  driver, all it does: {ours_s / elapsed_s:.1%} of a core",
        "  canopen library, a callback for each PDO, no sets, no SYNCs: "
        f"{theirs_s / elapsed_s:.1%} of a core ({n_library} frames)",
    ]


def stream_line(deliveries: list[object]) -> str:
    blocks = [d for d in deliveries if isinstance(d, CountSamples)]
    faults = Counter[str]()
    for fault in (d for d in deliveries if isinstance(d, DeviceFault)):
        faults[fault.code] += fault.count
    n = sum(len(block.seq) for block in blocks)
    last = int(blocks[-1].seq[-1]) + 1
    missing = wrong = 0
    first = blocks[0].counts[0].astype(np.int64)
    for block in blocks:
        missed = (block.status & STATUS_MISSING) != 0
        missing += int(missed.sum())
        steps = block.counts - first
        wrong += int(((steps != np.median(steps, axis=1)[:, None]) & ~missed).sum())
    return (
        f"{n} samples of {last} SYNCs, {last - n} lost, {missing} readings missing, "
        f"{wrong} of another SYNC; faults stream_line: {dict(faults) or 'none'}"
    )


def dispatch(n_syncs: int = 20_000) -> str:
    frames = [
        (0x180 + node, bytearray(u32(k))) for k in range(n_syncs) for node in NODES
    ]
    moduli = [1 << 24] * len(NODES)
    counts = [0] * len(NODES)
    cycles = SyncCycleAssembler(
        "arm", NODES, moduli, counts, lambda _: None, late_ns=10**8
    )
    cycles.restart(1)
    begun_ns = time.thread_time_ns()
    for k in range(n_syncs):
        cycles.sync(k * 1_000_000)
        for can_id, data in frames[k * len(NODES) : (k + 1) * len(NODES)]:
            cycles.take(can_id, data)
        cycles.flush(k * 1_000_000)
    ours_us = (time.thread_time_ns() - begun_ns) / len(frames) / 1e3
    library = LibraryReader()
    begun_ns = time.thread_time_ns()
    for can_id, data in frames:
        library.network.notify(can_id, data, 0.0)
    theirs_us = (time.thread_time_ns() - begun_ns) / len(frames) / 1e3
    library.network.disconnect()
    return (
        f"dispatch of a position, frames already read: {ours_us:.2f} us here, sets and "
        f"blocks included; {theirs_us:.2f} us by the library's callback"
    )


def main(seconds: float = SECONDS) -> None:
    logging.getLogger("canopen").setLevel(logging.CRITICAL)
    print(dispatch(), flush=True)
    for sync in ("external", "host"):
        print("\n".join(asyncio.run(measure(seconds, sync))), flush=True)


if __name__ == "__main__":
    run_main(main)
