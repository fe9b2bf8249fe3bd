"""Encoders that answer later than a period: no count is of another SYNC unseen."""

import bisect

import numpy as np
import pytest

from tests.drivers.canopen.rig import CanRig
from tests.drivers.driver_contract import streaming
from tests.drivers.taken import Taken, until
from traverse.drivers.base.values import CountSamples

RATE_HZ = 50.0
PERIOD_S = 1.0 / RATE_HZ
FIRST = {5: 1000, 9: 1007}


def judge(taken: Taken, synced_ns: list[int]) -> tuple[int, list[str]]:
    """How many counts bear no flag, and those of them that are of another SYNC."""
    n_good, false = 0, []
    for block in taken.of(CountSamples):
        for at_ns, counts, status in zip(
            block.sample_time_ns, block.counts, block.status, strict=True
        ):
            # The nodes count SYNCs; a stamp is right after the sending.
            n_th = bisect.bisect_right(synced_ns, int(at_ns)) - 1
            truth = [first + n_th for first in FIRST.values()]
            good = status == 0
            n_good += int(good.sum())
            if (counts != truth)[good].any():
                false.append(f"{counts} {status} at SYNC {n_th}: {truth}")
    return n_good, false


@pytest.mark.parametrize("late", [(9,), (5, 9)])
async def test_answers_that_come_after_the_next_sync_are_not_taken_for_it(late):
    # The driver sends the SYNCs; a busy computer stops for two seconds.
    host = {"sync": "host", "heartbeat_ms": 1000, "late_s": 2.0}
    with CanRig(**host) as rig, rig.driver:
        rig.nodes.answers_sync = True
        taken = await streaming(rig, RATE_HZ)
        await taken.until(lambda: len(taken.seqs()) >= 5, "samples in time")
        for number in late:
            rig.nodes.nodes[number].late_s = 1.3 * PERIOD_S
        n_before = len(rig.nodes.synced_ns)
        await until(lambda: len(rig.nodes.synced_ns) > n_before + 20, "20 late SYNCs")
        for number in late:
            rig.nodes.nodes[number].late_s = 0.0
        n_before = len(rig.nodes.synced_ns)
        await until(lambda: len(rig.nodes.synced_ns) > n_before + 20, "20 in time")
        taken.all += await rig.delivery_queue.take()
    n_good, false = judge(taken, rig.nodes.synced_ns)
    assert not false
    assert n_good > 10
    assert np.diff(taken.seqs()).min() >= 1
