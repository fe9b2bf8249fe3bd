"""The CANopen driver: the common suites, and what only it does."""

import asyncio
import contextlib
import itertools
from collections.abc import AsyncIterator
from random import Random

import pytest

from drivers.canopen import CanOpen
from drivers.crossing import Crossing
from drivers.values import (
    STATUS_ERROR,
    STATUS_LATE,
    STATUS_MISSING,
    STATUS_WARNING,
    CountSamples,
    DeviceAlarm,
    DeviceFault,
    DeviceLost,
    DeviceUp,
    StreamStarted,
)
from tests.drivers.driver_contract import DriverContract, StreamContract, streaming, up
from tests.drivers.fake_canopen import FakeNodes, u16, u32
from tests.drivers.taken import Taken, until

channels = itertools.count()


class CanRig:
    """A driver whose SYNCs come from elsewhere: a test says when."""

    def __init__(self, crossing: Crossing, **options: object) -> None:
        channel = f"bus-{next(channels)}"
        self.crossing = crossing
        self.nodes = FakeNodes(channel)
        self.port = f"virtual:{channel}"
        given = {
            "interface": "virtual",
            "channel": channel,
            "nodes": (5, 9),
            "sync": "external",
            "heartbeat_ms": 100,
            "answer_s": 0.1,
            "answer_tries": 2,
            "status_period_s": 0.0,
        } | options
        self.driver = CanOpen("arm", crossing, **given)
        self.nodes.plug()

    def emit(self, n: int) -> None:
        self.nodes.sync(n)

    def lose(self, n: int) -> None:
        self.nodes.sync(n, lost=True)

    def unplug(self) -> None:
        self.nodes.unplug()

    def plug(self) -> None:
        self.nodes.plug()

    def close(self) -> None:
        self.driver.close()
        self.nodes.unplug()


@pytest.fixture
async def rig() -> AsyncIterator[CanRig]:
    made = CanRig(Crossing(asyncio.get_running_loop()))
    yield made
    made.close()


class TestCanOpen(DriverContract, StreamContract):
    pass


def alarms(taken: Taken, code: str) -> list[tuple[int | None, bool]]:
    found = [alarm for alarm in taken.of(DeviceAlarm) if alarm.code == code]
    assert all(alarm.remedy and alarm.text for alarm in found)
    return [(alarm.channel, alarm.raised) for alarm in found]


def last_status(taken: Taken) -> list[int]:
    blocks = taken.of(CountSamples)
    return blocks[-1].status[-1].tolist() if blocks else []


async def until_status(rig: CanRig, taken: Taken, status: list[int]) -> None:
    """SYNCs until a sample has this status."""
    async with asyncio.timeout(8):
        while last_status(taken) != status:
            await answered(rig, taken)


async def answered(rig: CanRig, taken: Taken) -> None:
    """One SYNC, and what is delivered then."""
    rig.emit(1)
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(0.03):  # samples alone need not wake it
            taken.all += await rig.crossing.take()


async def test_nodes_are_set_up_in_the_portable_way(rig: CanRig):
    with rig.driver:
        await up(rig)
        # The nodes live in a thread of their own, which may be behind.
        await until(lambda: (0x000, b"\x01\x09") in rig.nodes.heard, "both are started")
        told = [frame for frame in rig.nodes.heard if frame[0] in (0x000, 0x605)]
    written = [data.hex(" ") for _, data in told if len(data) == 2 or data[0] & 0x20]
    # Bytes by hand: PDO off, at every SYNC, one object 6004:00 of 32 bits, TPDO2 off,
    # heartbeat 100 ms, NMT.
    assert written[0] == "80 05"
    assert [w for w in written if not w.endswith(" 09")][1:] == [
        "23 00 18 01 85 01 00 80",
        "2f 00 18 02 01 00 00 00",
        "2f 00 1a 00 00 00 00 00",
        "23 00 1a 01 20 00 04 60",
        "2f 00 1a 00 01 00 00 00",
        "23 00 18 01 85 01 00 00",
        "23 01 18 01 85 02 00 80",
        "2b 17 10 00 64 00 00 00",
        "01 05",
    ]


async def test_identity_is_read_from_the_nodes(rig: CanRig):
    scaled = rig.nodes.nodes[9]
    scaled.objects |= {
        (0x6000, 0): u16(4),
        (0x6001, 0): u32(4096),
        (0x6002, 0): u32(4096 * 16),
    }
    with rig.driver:
        taken = await up(rig)
    identity = taken.of(DeviceUp)[0].identity
    assert identity.counts_per_turn == (1 << 16, 4096)
    assert identity.moduli_counts == (1 << 28, 4096 * 16)
    assert not identity.latches
    assert identity.inputs == 0
    assert "5:5f-406-5" in identity.name


@pytest.mark.parametrize(("wanted", "bits"), [("cw", 4), ("ccw", 5)])
async def test_the_code_sequence_is_set_and_the_other_bits_stay(wanted: str, bits: int):
    rig = CanRig(Crossing(asyncio.get_running_loop()), code_sequence=wanted)
    for node in rig.nodes.nodes.values():
        node.objects[(0x6000, 0)] = u16(5 if wanted == "cw" else 4)
        node.objects |= {(0x6001, 0): u32(4096), (0x6002, 0): u32(4096)}
    try:
        with rig.driver:
            await up(rig)
        assert rig.nodes.nodes[5].objects[(0x6000, 0)] == u16(bits)
    finally:
        rig.close()


async def test_all_that_is_wrong_at_the_start_is_told_together(rig: CanRig):
    rig.nodes.nodes[5].objects[(0x1000, 0)] = u32(0x0002_0191)
    rig.nodes.nodes[9].objects[(0x6501, 0)] = u32(0)
    with rig.driver:
        taken = Taken(rig.crossing)
        await taken.until(lambda: taken.of(DeviceLost), "the refusal")
    (lost,) = taken.of(DeviceLost)
    assert "node 5 says it is a device of profile 401, expected an encoder" in (
        lost.reason
    )
    assert "node 9 on" in lost.reason
    assert "0 counts per turn" in lost.reason


async def test_a_node_that_is_missing_at_the_start_is_named(rig: CanRig):
    rig.nodes.nodes[9].mute = True
    with rig.driver:
        taken = Taken(rig.crossing)
        await taken.until(lambda: taken.of(DeviceLost), "the loss")
        (lost,) = taken.of(DeviceLost)
        assert f"nodes 9 on {rig.port} do not answer; nodes 5 do" in lost.reason
        rig.nodes.nodes[9].mute = False
        await taken.until(lambda: taken.of(DeviceUp), "both")


async def test_a_fixed_map_is_good_if_the_position_comes_first(rig: CanRig):
    node = rig.nodes.nodes[5]
    node.refuses = {(0x1A00, 0), (0x1A00, 1)}
    node.objects |= {(0x1A00, 0): b"\x01", (0x1A00, 1): u32(0x6004_0020)}
    with rig.driver:
        taken = await streaming(rig)
        await until_status(rig, taken, [0, 0])


async def test_a_lost_node_is_told_and_set_up_again_when_it_is_back(rig: CanRig):
    lost = rig.nodes.nodes[9]
    with rig.driver:
        taken = await streaming(rig)
        await until_status(rig, taken, [0, 0])
        last = int(taken.of(CountSamples)[-1].counts[-1, 1])
        lost.mute = True
        await until_status(rig, taken, [0, STATUS_MISSING])
        assert int(taken.of(CountSamples)[-1].counts[-1, 1]) == last
        await taken.until(lambda: alarms(taken, "node_lost"), "the loss")
        lost.mute = False
        rig.nodes.restart(9)
        await taken.until(lambda: len(alarms(taken, "node_lost")) == 2, "it is back")
        await until_status(rig, taken, [0, 0])
    assert alarms(taken, "node_lost") == [(1, True), (1, False)]
    assert taken.of(DeviceLost) == []
    codes = [fault.code for fault in taken.of(DeviceFault)]
    assert "readings_missing" in codes
    assert codes.count("node_restarted") == 1


async def test_a_node_that_has_become_another_is_not_measured_with(rig: CanRig):
    with rig.driver:
        taken = await streaming(rig)
        rig.nodes.nodes[9].per_turn = 1 << 13
        rig.nodes.restart(9)
        await taken.until(lambda: len(taken.of(DeviceUp)) == 2, "it is told anew")
    reasons = [lost.reason for lost in taken.of(DeviceLost)]
    assert any("came back with 8192 counts per turn" in reason for reason in reasons)
    assert taken.of(DeviceUp)[1].identity.counts_per_turn == (1 << 16, 1 << 13)


async def test_a_node_that_was_stopped_is_started_again(rig: CanRig):
    with rig.driver:
        taken = await streaming(rig)
        rig.nodes.nodes[5].state = 4
        await taken.until(lambda: rig.nodes.nodes[5].state == 5, "it is started")
        await until_status(rig, taken, [0, 0])
    assert [f for f in taken.of(DeviceFault) if f.code == "node_restarted"] == []


async def test_emergencies_and_alarms_begin_and_end(rig: CanRig):
    node = rig.nodes.nodes[5]
    with rig.driver:
        taken = await streaming(rig)
        node.objects[(0x6503, 0)] = u16(1)
        rig.nodes.send(0x085, bytes.fromhex("00 10 01 01 00 00 00 00"))
        await taken.until(lambda: alarms(taken, "emergency"), "the emergency")
        alarm = next(a for a in taken.of(DeviceAlarm) if a.code == "emergency")
        assert alarm.value == 0x1000
        assert "node 5: generic error (code 1000, error register 01" in alarm.text
        with pytest.raises(StopIteration):  # 6503 is read only where it is asked for
            next(a for a in taken.of(DeviceAlarm) if a.code == "encoder_alarm")
        await until_status(rig, taken, [STATUS_WARNING, 0])
        rig.nodes.send(0x085, bytes(8))
        await taken.until(lambda: len(alarms(taken, "emergency")) == 2, "its end")
        await until_status(rig, taken, [0, 0])
    assert alarms(taken, "emergency") == [(0, True), (0, False)]


async def test_alarms_of_the_profile_are_read_from_time_to_time():
    rig = CanRig(Crossing(asyncio.get_running_loop()), status_period_s=0.1)
    node = rig.nodes.nodes[9]
    try:
        with rig.driver:
            taken = await streaming(rig)
            node.objects |= {(0x6503, 0): u16(1), (0x6505, 0): u16(1 << 4)}
            await until_status(rig, taken, [0, STATUS_ERROR | STATUS_WARNING])
            node.objects |= {(0x6503, 0): u16(0), (0x6505, 0): u16(0)}
            await until_status(rig, taken, [0, 0])
    finally:
        rig.close()
    found = [(a.code, a.raised, a.text) for a in taken.of(DeviceAlarm)]
    assert found == [
        ("encoder_alarm", True, "node 9: position error (0001)"),
        ("encoder_warning", True, "node 9: battery low (0010)"),
        ("encoder_alarm", False, "over: node 9: position error (0001)"),
        ("encoder_warning", False, "over: node 9: battery low (0010)"),
    ]


async def test_two_nodes_with_one_number_are_told(rig: CanRig):
    with rig.driver:
        taken = await streaming(rig)
        await until_status(rig, taken, [0, 0])
        rig.nodes.nodes[5].doubles = True
        await until_status(rig, taken, [STATUS_ERROR | STATUS_LATE, 0])
    assert alarms(taken, "duplicate_node") == [(0, True)]


async def test_two_nodes_with_one_number_are_told_at_the_start(rig: CanRig):
    rig.nodes.nodes[9].doubles = True
    with rig.driver:
        taken = await up(rig)
        await taken.until(lambda: alarms(taken, "duplicate_node"), "the alarm")
    assert alarms(taken, "duplicate_node") == [(1, True)]


async def test_a_bus_that_is_off_is_told_until_it_is_back(rig: CanRig):
    with rig.driver:
        taken = await streaming(rig)
        rig.nodes.send(0x040, bytes(8), error=True)
        await taken.until(lambda: alarms(taken, "bus_off"), "the alarm")
        rig.nodes.send(0x100, bytes(8), error=True)
        await taken.until(lambda: len(alarms(taken, "bus_off")) == 2, "its end")
    assert alarms(taken, "bus_off") == [(None, True), (None, False)]


async def test_the_driver_sends_the_syncs_itself():
    rig = CanRig(Crossing(asyncio.get_running_loop()), sync="host")
    rig.nodes.answers_sync = True
    try:
        with rig.driver:
            taken = await streaming(rig, 200.0)
            await taken.until(lambda: len(taken.seqs()) >= 50, "50 samples")
    finally:
        rig.close()
    blocks = taken.of(CountSamples)
    counts = [c for block in blocks for c in block.counts.tolist()]
    known = {tuple(c) for c in counts}
    assert known <= {(1000 + k, 1007 + k) for k in range(400)}  # of one SYNC each
    assert taken.of(StreamStarted)[0].rate_hz == 200.0


async def test_a_stream_can_be_stopped_and_begun_again(rig: CanRig):
    with rig.driver:
        taken = await streaming(rig)
        rig.emit(3)
        await taken.until(lambda: len(taken.seqs()) >= 3, "3 samples")
        rig.driver.request_stream(0.0)
        rig.driver.request_stream(100.0)
        await taken.until(lambda: len(taken.of(StreamStarted)) == 2, "another stream")
        rig.emit(2)
        await taken.until(lambda: len(taken.seqs()) >= 5, "2 samples more")
    assert taken.seqs() == [0, 1, 2, 0, 1]


async def test_noise_on_the_bus_ends_nothing(rig: CanRig):
    random = Random(3)
    with rig.driver:
        taken = await streaming(rig)
        for _ in range(2000):
            node = random.choice([0, 5, 9, 17])
            service = random.choice([0x080, 0x180, 0x280, 0x580, 0x700, 0x780])
            n = random.randrange(9)
            rig.nodes.send(service + node, random.randbytes(n), random.random() < 0.1)
        async with asyncio.timeout(8):
            # Both answer again; what else the noise said of them stays told.
            while [bits & STATUS_MISSING for bits in last_status(taken)] != [0, 0]:
                await answered(rig, taken)
    assert all(
        "fault in the driver" not in lost.reason for lost in taken.of(DeviceLost)
    )
    counts = [row for block in taken.of(CountSamples) for row in block.counts.tolist()]
    assert len(counts) == len(taken.seqs())


@pytest.fixture(autouse=True)
def quiet_library(caplog: pytest.LogCaptureFixture) -> None:
    """The library logs each abort that we asked for on purpose."""
    caplog.set_level("CRITICAL", logger="canopen")
