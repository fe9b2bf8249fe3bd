"""The driver alone on vcan0, as fast as encoders answer on an emulated computer."""

import asyncio
import contextlib
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass

import numpy as np

from tests.vm.bus_checks import NODES
from tests.vm.can_interface import NAME
from tests.vm.table import Table
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import (
    STATUS_LATE,
    STATUS_MISSING,
    CountSamples,
    DeviceUp,
    StreamStarted,
)
from traverse.drivers.canopen.driver import CanOpenDriver
from traverse.drivers.canopen.options import CanOpenOptions

RATES_HZ = (200.0, 100.0, 50.0, 20.0, 10.0)
STEADY_S, START_S = 20.0, 60.0
LATE_HZ, LATE_S = 20.0, 0.065  # answers after the next SYNC


class Stream:
    def __init__(self, sync: str) -> None:
        self._delivery_queue = DeliveryQueue(asyncio.get_running_loop())
        self._driver = CanOpenDriver(
            "arm",
            CanOpenOptions(
                interface="socketcan",
                channel=NAME,
                nodes=NODES,
                sync=sync,
                heartbeat_ms=2000,
                answer_s=2.0,
                late_s=0.5,  # an emulated computer is suspended now and then
            ),
            self._delivery_queue,
        )
        self._taken: list[object] = []

    async def steady(self) -> str:
        """The fastest of some rates without loss, and the losses at faster ones."""
        lines: list[str] = []
        with self._driver:
            await self._until(lambda d: isinstance(d, DeviceUp))
            for rate_hz in RATES_HZ:
                self._taken.clear()
                self._driver.request_stream(rate_hz)
                await self._until(lambda d: isinstance(d, StreamStarted))
                await self._take(1.0)
                self._taken.clear()
                await self._take(STEADY_S)
                outcome = judge(self._taken)
                lines.append(f"{rate_hz:g} Hz: {outcome}")
                assert not outcome.false, lines[-1]
                if outcome.steady:
                    break
        assert outcome.steady, "; ".join(lines)
        return "; ".join(reversed(lines))

    async def doubt(self) -> str:
        """Answers that arrive after the next SYNC are waited for, or flagged."""
        with self._driver:
            await self._until(lambda d: isinstance(d, DeviceUp))
            self._driver.request_stream(LATE_HZ)
            await self._until(lambda d: isinstance(d, StreamStarted))
            await self._take(STEADY_S)
        outcome = judge(self._taken)
        assert not outcome.false, str(outcome)
        assert outcome.n > STEADY_S, str(outcome)
        return f"{LATE_HZ:g} Hz: {outcome}"

    async def _until(self, is_it: Callable[[object], bool]) -> None:
        async with asyncio.timeout(START_S):
            while not any(map(is_it, self._taken)):
                self._taken += await self._delivery_queue.take()

    async def _take(self, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self._taken += await self._delivery_queue.take()


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a stream.

    Attributes:
        n: samples.
        unsent: SYNCs that the guest's kernel left out: it was late itself.
        lost: SYNCs that the encoders saw and that gave no sample.
        missing: readings that were not there, and flagged so.
        late: samples flagged as perhaps of another SYNC.
        false: samples with a count of another SYNC and no flag.
    """

    n: int
    unsent: int
    lost: int
    missing: int
    late: int
    false: int

    @property
    def steady(self) -> bool:
        """Nothing was lost on the way."""
        return not (self.lost or self.missing or self.late)

    def __str__(self) -> str:
        return (
            f"{self.n} samples, {self.lost} lost, {self.missing} readings missing, "
            f"{self.late} flagged late, {self.false} false; "
            f"{self.unsent} SYNCs not sent"
        )


def judge(deliveries: list[object]) -> Outcome:
    """Compare samples with the SYNCs that the encoders have counted."""
    blocks = [d for d in deliveries if isinstance(d, CountSamples)]
    seq = np.concatenate([b.seq for b in blocks])
    counts = np.concatenate([b.counts for b in blocks]).astype(np.int64)
    status = np.concatenate([b.status for b in blocks])
    n_th = counts - 1000 * np.array(NODES)
    flagged = (status != 0).any(axis=1)
    true = n_th[:, 0][~flagged]
    seen = int(true[-1] - true[0]) + 1
    between = slice(*np.flatnonzero(~flagged)[[0, -1]] + (0, 1))
    n = len(seq[between])
    span = int(seq[between][-1] - seq[between][0]) + 1
    disagree = (n_th != n_th[:, :1]).any(axis=1) & ~flagged
    return Outcome(
        n,
        max(0, span - seen),
        max(0, seen - n),
        int(((status & STATUS_MISSING) != 0).sum()),
        int(((status & STATUS_LATE) != 0).any(axis=1).sum()),
        int(disagree.sum()) + int((np.diff(true) < 1).sum()),
    )


async def check_stream(table: Table) -> None:
    async with _nodes():
        title = f"the driver alone, {STEADY_S:g} s without loss"
        await table.check(title, Stream("kernel").steady)
    async with _nodes(LATE_S):
        for sync in ("kernel", "host"):
            title = f"an encoder that answers late, SYNC by {sync}"
            await table.check(title, Stream(sync).doubt)


@contextlib.asynccontextmanager
async def _nodes(*late_s: float) -> AsyncIterator[None]:
    words = (sys.executable, "-m", "tests.vm.quick_nodes", *map(str, late_s))
    nodes = await asyncio.create_subprocess_exec(*words, stdout=subprocess.PIPE)
    try:
        assert nodes.stdout is not None
        await nodes.stdout.readline()
        yield
    finally:
        nodes.kill()
        await nodes.wait()
