"""`python -m benchmarks.service.scan_outage [SECONDS]`: scans without a broker.

A real daemon scans the simulated arm at 1 kHz; mosquitto is killed, stays away for 20
seconds and comes back. Once with each delivery: which points does a consumer have in
the end, are gaps reported, and were all encoders read meanwhile?
"""

import asyncio
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.tools.command_line import run_main
from benchmarks.tools.rounds import load
from tests import programs
from tests.end_to_end.listener import numbers
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import SWEEP, Workbench
from tests.mosquitto import Mosquitto
from traverse.protocol.messages import Scan
from traverse.testing.waiting import until

SECONDS = 20.0
RATE_HZ = 1000.0
BEFORE_POINTS = 2000
BLOCKS = "scan_block_s = 0.02"  # 1000 in the outage: more than wait in memory
PATIENCE_S = 120.0


@dataclass(frozen=True, slots=True)
class Outage:
    """Received part of one scan.

    Attributes:
        total: points of the scan, by its last block.
        arrived, twice: points that a consumer received, received more than once.
        gaps: stretches of numbers that are missing.
        reported: points of these that the blocks report as dropped or lost.
        blocks_in_order: whether blocks first arrived in the order of their numbers.
        after_s: from the broker's return until nothing was missing, or none arrived.
    """

    delivery: str
    total: int
    arrived: int
    twice: int
    gaps: int
    reported: int
    blocks_in_order: bool
    samples_lost: int
    after_s: float

    def line(self) -> str:
        order = "in order" if self.blocks_in_order else "NOT in order"
        return (
            f"{self.delivery:8}: {self.arrived} of {self.total} points, {order}, "
            f"{self.total - self.arrived} missing in {self.gaps} gaps ({self.reported} "
            f"reported as dropped), {self.twice} came twice; {self.samples_lost} "
            "samples lost between board and daemon; settled "
            f"{self.after_s:.1f} s after the return"
        )


async def outage(folder: Path, delivery: str, seconds: float) -> Outage:
    program = programs.find("mosquitto")
    if program is None:
        raise SystemExit("benchmarks.service.scan_outage: mosquitto is not installed")
    broker = Mosquitto(folder, program=program)
    broker.start()
    bench = Workbench(folder, broker.host, broker.port)
    bench.write_simulator(SWEEP, top="repeat = true")
    bench.write_daemon(scan=f'delivery = "{delivery}"', capture=BLOCKS)
    loop = asyncio.get_running_loop()
    try:
        async with measuring(bench) as (listener, _, _):
            scan = await listener.start_scan(RATE_HZ)
            await listener.scan_points(scan, BEFORE_POINTS)
            broker.kill()
            await asyncio.sleep(seconds)
            listener.statuses.clear()
            broker.start()
            back_s = loop.time()
            await until(lambda: listener.connected, "a connection")
            await listener.ready()
            await listener.scan_points(
                scan, int((seconds + 5) * RATE_HZ) + BEFORE_POINTS, PATIENCE_S
            )
            total = (await listener.stop_scan(scan))[-1].total or 0
            after_s = loop.time() - back_s
            health = listener.healths[-1]
    finally:
        broker.kill()
    return _judged(
        delivery, listener.scans, total, health.counters["samples_lost"], after_s
    )


def _judged(
    delivery: str, blocks: list[Scan], total: int, samples_lost: int, after_s: float
) -> Outage:
    firsts = list(dict.fromkeys(block.seq for block in blocks))
    seq, counts = np.unique(numbers(blocks), return_counts=True)
    return Outage(
        delivery,
        total,
        len(seq),
        int((counts > 1).sum()),
        int((np.diff([-1, *seq.tolist(), total]) > 1).sum()),
        blocks[-1].dropped + blocks[-1].lost,
        firsts == sorted(firsts),
        samples_lost,
        after_s,
    )


def main(seconds: float = SECONDS) -> int:
    """Print the results of both; 1 if a complete scan was not."""
    print(load())
    outages = []
    for delivery in ("complete", "live"):
        with tempfile.TemporaryDirectory() as folder:
            outages.append(asyncio.run(outage(Path(folder), delivery, seconds)))
        print(outages[-1].line(), flush=True)
    print(load())
    complete = outages[0]
    return int(complete.arrived != complete.total or not complete.blocks_in_order)


if __name__ == "__main__":
    run_main(main)
