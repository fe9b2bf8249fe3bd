"""A day of the Mega's firmware, hour by hour in fast forward.

The binary for the board runs in its emulator while seven incremental encoders turn. At
the end of each hour a driver connects, receives a stream for a second, and the button
is pressed or released. Judged against the emulator: the counts that were latched, the
tick of the edge (a counter of 32 bits, which wraps each 36 minutes), its number, and
that nothing is reported lost or broken. A step of the board's clock is not judged: a
busy computer's emulator falls behind and catches up. Ends with status 1 if anything is
wrong.
"""

import argparse
import asyncio
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.tools.sizes import sized
from tests.firmware.emulated import Press, ProcessorRig
from tests.firmware.mega import CYCLES_PER_TICK, MegaBoard, mega_firmware
from traverse.drivers.base.values import (
    STATUS_ERROR,
    DeviceAlarm,
    DeviceFault,
    DeviceUp,
    LatchedCounts,
)
from traverse.testing.deliveries import Deliveries
from traverse.testing.waiting import until

COUNTS_PER_TURN = 10_000  # divides no power of two: an overflow would show
WRAP_TICKS = 2**32
FIRST_TICKS = WRAP_TICKS - 2_000_000  # the first wrap comes within a second
COUNTS_PER_S = (25, -2, 7, 0, -19, 3, 11)  # of each encoder
RATE_HZ = 100.0
N_SAMPLES = 100
HOUR_S = sized(3600, 5)
# Contact and latch may lie in two counts, and in two ticks.
COUNTS_APART = 1
TICKS_APART = 2


@dataclass(frozen=True, slots=True)
class Edge:
    """Counts of a driver and of the emulator at the end of an hour.

    Attributes:
        latches: every edge that was received.
        reports: alarms and faults.
        seqs: numbers of the samples that were received.
        press: the contact.
    """

    latches: list[LatchedCounts]
    reports: list[DeviceAlarm | DeviceFault]
    seqs: list[int]
    press: Press


def apart(value: int, other: int, modulus: int) -> int:
    difference = (value - other) % modulus
    return min(difference, modulus - difference)


def errors(edge: Edge, number: int, first: Edge) -> Iterator[str]:
    """Name an edge's faults, with the first edge as the origin of time."""
    for report in edge.reports:
        if report.code != "clock_stepped":
            yield str(report)
    if edge.seqs != list(range(len(edge.seqs))):
        yield "samples are missing"
    if [latch.token for latch in edge.latches] != [number]:
        yield f"edges received: {edge.latches}"
        return
    (latch,) = edge.latches
    if any(status & STATUS_ERROR for status in latch.status):
        yield f"status of the encoders {latch.status}"
    differences = (
        apart(count, true_count, COUNTS_PER_TURN)
        for count, true_count in zip(latch.counts, edge.press.counts, strict=True)
    )
    if max(differences) > COUNTS_APART:
        yield f"counts {latch.counts}, of the emulator {edge.press.counts}"
    cycles = edge.press.contact_cycle - first.press.contact_cycle
    ticks = latch.device_ticks - first.latches[0].device_ticks
    if apart(ticks, cycles // CYCLES_PER_TICK, WRAP_TICKS) > TICKS_APART:
        yield f"tick {latch.device_ticks} at cycle {edge.press.contact_cycle}"


async def hour_end(board: MegaBoard) -> Edge:
    """Connect a driver, receive some samples, press or release the button."""
    rig = ProcessorRig(board, debounce_us=5000)
    board.do(*(f"turn {n} {rate}" for n, rate in enumerate(COUNTS_PER_S)))
    with rig.driver:
        received = Deliveries(rig.delivery_queue)
        await received.until(lambda: received.of(DeviceUp), "the board is up")
        rig.driver.request_stream(RATE_HZ)
        await received.until(lambda: len(received.seqs()) > N_SAMPLES, "samples")
        rig.press()
        press = board.last_press()
        await received.until(lambda: received.of(LatchedCounts), "the edge")
        latches = received.of(LatchedCounts)
        rig.driver.acknowledge(latches[-1].token)
        await until(lambda: not rig.unacknowledged(), "the acknowledgement")
    reports: list[DeviceAlarm | DeviceFault] = [
        *received.of(DeviceAlarm),
        *received.of(DeviceFault),
    ]
    return Edge(latches, reports, received.seqs(), press)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.drivers.board_day")
    parser.add_argument("--hours", type=int, default=sized(24, 2))
    hours: int = parser.parse_args().hours
    n_wrong = 0
    began_s = time.monotonic()
    per_turn = ",".join([str(COUNTS_PER_TURN)] * len(COUNTS_PER_S))
    with (
        tempfile.TemporaryDirectory() as folder,
        MegaBoard(
            Path(folder) / "port",
            mega_firmware(f"COUNTS_PER_TURN={{{per_turn}}}"),
            *("--counts-per-turn", str(COUNTS_PER_TURN)),
            *("--first-ticks", str(FIRST_TICKS)),
        ) as board,
    ):
        first = edge = asyncio.run(hour_end(board))
        for number in range(hours + 1):
            if number > 0:
                board.do(f"forward {HOUR_S}")
                edge = asyncio.run(hour_end(board))
            wrong = list(errors(edge, number, first))
            n_wrong += len(wrong)
            cycles = edge.press.contact_cycle - first.press.contact_cycle
            n_wraps = cycles / CYCLES_PER_TICK / WRAP_TICKS
            print(
                f"hour {number:2d}: {n_wraps:5.2f} wraps of the counter, "
                f"counts {edge.latches[-1].counts}: {'; '.join(wrong) or 'right'}",
                flush=True,
            )
    took_min = (time.monotonic() - began_s) / 60
    print(f"{hours} hours in {took_min:.1f} min: {n_wrong} errors")
    sys.exit(n_wrong > 0)


if __name__ == "__main__":
    main()
