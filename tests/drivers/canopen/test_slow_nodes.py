"""CANopen encoders that answer questions late are slow, not two.

Encoders that answer later than a period: no count is of another SYNC unseen.
"""

import bisect
from collections.abc import Iterator

import numpy as np
import pytest

from tests.drivers.canopen.rig import CanRig, channels
from traverse.drivers.base.values import CountSamples, DeviceAlarm, DeviceLost
from traverse.drivers.canopen.sdo import NodeError, NodeSdo
from traverse.drivers.io.can_bus import CanBus
from traverse.testing.deliveries import Deliveries
from traverse.testing.driver_contract import streaming
from traverse.testing.waiting import until

ALARMS, WARNINGS = 0x6503, 0x6505
QUICK_S = 0.02
ASK_TYPE = bytes.fromhex("40 00 10 00 00 00 00 00")


def answer(index: int, value: int = 0) -> bytes:
    """The answer of two bytes about an object."""
    return b"\x4b" + index.to_bytes(2, "little") + b"\0" + value.to_bytes(4, "little")


class Slow:
    """An SDO client, and its node's frames at each of the next reads of the bus."""

    def __init__(self, bus: CanBus) -> None:
        self.says: list[list[bytes]] = []
        self.now_ns = 0
        self.sdo = NodeSdo(
            9,
            bus,
            self._turn,
            stopping=lambda: False,
            answer_s=QUICK_S,
            tries=2,
            monotonic_ns=lambda: self.now_ns,
        )

    def _turn(self, limit_s: float) -> None:
        self.now_ns += int(limit_s * 1e9)
        for data in self.says.pop(0) if self.says else []:
            self.sdo.take(data)


@pytest.fixture
def slow(caplog: pytest.LogCaptureFixture) -> Iterator[Slow]:
    caplog.set_level("CRITICAL", logger="canopen")  # the library logs each silence
    bus = CanBus("virtual", f"slow-{next(channels)}", 1_000_000)
    yield Slow(bus)
    bus.close()


def test_late_answers_to_tries_that_were_given_up_are_no_second_node(slow: Slow):
    with pytest.raises(NodeError, match="does not answer"):
        slow.sdo.read_number(ALARMS)
    slow.says = [[answer(ALARMS, 3), answer(ALARMS, 3), answer(ALARMS, 3)]]
    assert slow.sdo.read_number(ALARMS) == 3
    assert slow.sdo.surplus == 0
    slow.says = [[answer(ALARMS, 4), answer(ALARMS, 4)]]  # one question, two answers
    assert slow.sdo.read_number(ALARMS) == 4
    assert slow.sdo.surplus == 1


def test_a_late_answer_after_another_question_is_no_second_node(slow: Slow):
    slow.says = [[], [], [answer(ALARMS, 3)]]  # the second try, answered as the first
    assert slow.sdo.read_number(ALARMS) == 3
    slow.says = [[answer(ALARMS, 3), answer(WARNINGS, 5)]]
    assert slow.sdo.read_number(WARNINGS) == 5
    assert slow.sdo.surplus == 0


def test_what_others_have_asked_may_still_be_answered(slow: Slow):
    slow.sdo.expect(ASK_TYPE, 1)
    slow.says = [[answer(0x1000, 0x196), answer(0x1000, 0x196)]]
    assert slow.sdo.read_number(0x1000) == 0x196
    assert slow.sdo.surplus == 0


def test_a_question_that_is_never_answered_hides_a_second_node_for_a_while_only(
    slow: Slow,
):
    with pytest.raises(NodeError):
        slow.sdo.read_number(ALARMS)
    slow.now_ns += 6_000_000_000
    slow.says = [[answer(ALARMS), answer(ALARMS)]]
    assert slow.sdo.read_number(ALARMS) == 0
    assert slow.sdo.surplus == 1


class Reluctant:
    """Node 9 answers its first requests all at once, at the third
    time; node 5 answers nothing before that."""

    def __init__(self) -> None:
        self.held: list[tuple[int, bytes]] = []
        self.done = False

    def __call__(self, can_id: int, data: bytes) -> list[tuple[int, bytes]]:
        if self.done or can_id not in (0x585, 0x589):
            return [(can_id, data)]
        if can_id == 0x589:
            self.held.append((can_id, data))
        self.done = len(self.held) >= 3
        # The request to node 5 was the first: its answer is that of the last round.
        return [*self.held, (0x585, data)] if self.done else []


async def test_a_node_that_answers_an_earlier_connection_is_not_two() -> None:
    with CanRig(answer_s=0.05) as rig:
        rig.nodes.distort = Reluctant()
        with rig.driver:
            deliveries = await streaming(rig, 100.0)
    assert [alarm.code for alarm in deliveries.of(DeviceAlarm)] == []
    # On a busy machine an answer may be late by itself, and one more try be given up.
    losses = deliveries.of(DeviceLost)
    assert losses
    assert all("not answer" in loss.reason for loss in losses)


RATE_HZ = 50.0
PERIOD_S = 1.0 / RATE_HZ
FIRST = {5: 1000, 9: 1007}


def judge(deliveries: Deliveries, synced_ns: list[int]) -> tuple[int, list[str]]:
    """Return the number of unflagged samples, and those of them from another SYNC."""
    n_good, false = 0, []
    for block in deliveries.of(CountSamples):
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
        deliveries = await streaming(rig, RATE_HZ)
        await deliveries.until(lambda: len(deliveries.seqs()) >= 5, "samples in time")
        for number in late:
            rig.nodes.nodes[number].late_s = 1.3 * PERIOD_S
        n_before = len(rig.nodes.synced_ns)
        await until(lambda: len(rig.nodes.synced_ns) > n_before + 20, "20 late SYNCs")
        for number in late:
            rig.nodes.nodes[number].late_s = 0.0
        n_before = len(rig.nodes.synced_ns)
        await until(lambda: len(rig.nodes.synced_ns) > n_before + 20, "20 in time")
        deliveries.all += await rig.delivery_queue.take()
    n_good, false = judge(deliveries, rig.nodes.synced_ns)
    assert not false
    assert n_good > 10
    assert np.diff(deliveries.seqs()).min() >= 1
