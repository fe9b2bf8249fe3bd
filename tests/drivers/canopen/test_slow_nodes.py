"""CANopen encoders that answer questions late are slow, not two."""

from collections.abc import Iterator

import pytest

from tests.drivers.canopen.rig import CanRig, channels
from tests.drivers.driver_contract import streaming
from traverse.drivers.base.values import DeviceAlarm, DeviceLost
from traverse.drivers.canopen.sdo import NodeError, NodeSdo
from traverse.drivers.io.can_bus import CanBus

ALARMS, WARNINGS = 0x6503, 0x6505
QUICK_S = 0.02
ASK_TYPE = bytes.fromhex("40 00 10 00 00 00 00 00")


def answer(index: int, value: int = 0) -> bytes:
    """The answer of two bytes about an object."""
    return b"\x4b" + index.to_bytes(2, "little") + b"\0" + value.to_bytes(4, "little")


class Slow:
    """An SDO client, and what its node says at each of the next reads of the bus."""

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
            taken = await streaming(rig, 100.0)
    assert [alarm.code for alarm in taken.of(DeviceAlarm)] == []
    assert len(taken.of(DeviceLost)) == 1
