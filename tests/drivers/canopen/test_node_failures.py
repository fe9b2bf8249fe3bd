import asyncio
import time
from random import Random

import pytest

from tests.drivers.canopen.fake_nodes import u16, u32
from tests.drivers.canopen.rig import (
    CanRig,
    alarms,
    answered,
    last_status,
    until_status,
)
from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_LATE,
    STATUS_MISSING,
    STATUS_WARNING,
    CountSamples,
    DeviceAlarm,
    DeviceFault,
    DeviceLost,
    DeviceUp,
)
from traverse.testing.deliveries import Deliveries
from traverse.testing.driver_contract import streaming, up


async def test_a_lost_node_is_reported_and_set_up_again_when_it_is_back(rig: CanRig):
    lost = rig.nodes.nodes[9]
    with rig.driver:
        deliveries = await streaming(rig)
        await until_status(rig, deliveries, [0, 0])
        last = int(deliveries.of(CountSamples)[-1].counts[-1, 1])
        lost.mute = True
        await until_status(rig, deliveries, [0, STATUS_MISSING])
        assert int(deliveries.of(CountSamples)[-1].counts[-1, 1]) == last
        await deliveries.until(lambda: alarms(deliveries, "node_lost"), "the loss")
        lost.mute = False
        rig.nodes.restart(9)
        await deliveries.until(
            lambda: len(alarms(deliveries, "node_lost")) == 2, "it is back"
        )
        await until_status(rig, deliveries, [0, 0])
    assert alarms(deliveries, "node_lost") == [(1, True), (1, False)]
    assert deliveries.of(DeviceLost) == []
    codes = [fault.code for fault in deliveries.of(DeviceFault)]
    assert "readings_missing" in codes
    assert codes.count("node_restarted") == 1


async def test_a_node_that_has_become_another_is_not_measured_with(rig: CanRig):
    with rig.driver:
        deliveries = await streaming(rig)
        rig.nodes.nodes[9].per_turn = 1 << 13
        rig.nodes.restart(9)
        await deliveries.until(
            lambda: len(deliveries.of(DeviceUp)) == 2, "it is reported anew"
        )
    reasons = [lost.reason for lost in deliveries.of(DeviceLost)]
    assert any("restarted with 8192 counts per turn" in reason for reason in reasons)
    assert deliveries.of(DeviceUp)[1].identity.counts_per_turn == (1 << 16, 1 << 13)


@pytest.mark.parametrize(("number", "value"), [(0x6000, 1), (0x6509, 500)])
async def test_a_node_that_lost_its_preset_or_sense_is_told_apart(
    rig: CanRig, number: int, value: int
) -> None:
    power_up = rig.nodes.nodes[9].power_up

    def otherwise() -> None:
        power_up()
        rig.nodes.nodes[9].objects[(number, 0)] = u32(value)

    with rig.driver:
        deliveries = await streaming(rig)
        rig.nodes.nodes[9].power_up = otherwise
        rig.nodes.restart(9)
        await deliveries.until(
            lambda: len(deliveries.of(DeviceUp)) == 2, "it is reported anew"
        )
    assert "from another place" in deliveries.of(DeviceLost)[0].reason
    before, now = (up.identity.firmware for up in deliveries.of(DeviceUp))
    assert before != now  # so that it has to be confirmed


@pytest.mark.parametrize(
    ("number", "value", "text"),
    [
        ((0x6509, 0), u32(30), "6509:00 was unknown, is 1E"),  # a preset by 3 mrad
        ((0x6000, 0), u16(4), "6000:00 was 0, is 4"),
        ((0x1A00, 1), u32(0x6503_0010), "1A00:01 was 60040020, is 65030010"),
        ((0x1800, 2), b"\xfe", "1800:02 was 1, is FE"),
    ],
)
async def test_what_another_master_sets_while_it_measures_is_noticed(
    number: tuple[int, int], value: bytes, text: str
) -> None:
    rig = CanRig(status_period_s=0.2)
    with rig, rig.driver:
        deliveries = await streaming(rig)
        rig.nodes.nodes[9].objects[number] = value
        begun_ns = time.monotonic_ns()
        await deliveries.until(lambda: deliveries.of(DeviceLost), "it is noticed")
    lost = deliveries.of(DeviceLost)[0]
    assert text in lost.reason
    # Of both nodes one is looked at each 0.1 s: readings since then may be wrong.
    assert -1_000_000_000 < lost.since_ns - begun_ns < 1_000_000_000
    assert lost.since_ns < time.monotonic_ns()


async def test_a_node_that_accepts_its_settings_and_keeps_others_is_refused(
    rig: CanRig,
) -> None:
    rig.nodes.nodes[9].ignores = {(0x1800, 2)}
    with rig.driver:
        deliveries = Deliveries(rig.delivery_queue)
        await deliveries.until(lambda: deliveries.of(DeviceLost), "it is refused")
    lost = deliveries.of(DeviceLost)[0]
    assert "transmission type (1800:02) is FE, expected 1" in lost.reason
    assert deliveries.of(DeviceUp) == []


async def test_a_node_without_a_serial_number_may_be_another(rig: CanRig):
    power_up = rig.nodes.nodes[9].power_up

    def without_a_number() -> None:
        power_up()
        rig.nodes.nodes[9].objects[(0x1018, 4)] = u32(0)

    rig.nodes.nodes[9].power_up = without_a_number
    without_a_number()
    with rig.driver:
        deliveries = await streaming(rig)
        assert deliveries.of(DeviceUp)[0].identity.serials[1] == ""
        rig.nodes.restart(9)
        await deliveries.until(
            lambda: len(deliveries.of(DeviceUp)) == 2, "it is reported anew"
        )
    assert "no serial number shows" in deliveries.of(DeviceLost)[0].reason


async def test_a_node_that_was_stopped_is_started_again(rig: CanRig):
    with rig.driver:
        deliveries = await streaming(rig)
        rig.nodes.nodes[5].state = 4
        await deliveries.until(lambda: rig.nodes.nodes[5].state == 5, "it is started")
        await until_status(rig, deliveries, [0, 0])
    assert [f for f in deliveries.of(DeviceFault) if f.code == "node_restarted"] == []


async def test_emergencies_and_alarms_begin_and_end(rig: CanRig):
    node = rig.nodes.nodes[5]
    with rig.driver:
        deliveries = await streaming(rig)
        node.objects[(0x6503, 0)] = u16(1)
        rig.nodes.send(0x085, bytes.fromhex("00 10 01 01 00 00 00 00"))
        await deliveries.until(lambda: alarms(deliveries, "emergency"), "the emergency")
        alarm = next(a for a in deliveries.of(DeviceAlarm) if a.code == "emergency")
        assert alarm.value == 0x1000
        assert "node 5: generic error (code 1000, error register 01" in alarm.text
        with pytest.raises(StopIteration):  # 6503 is read only where it is configured
            next(a for a in deliveries.of(DeviceAlarm) if a.code == "encoder_alarm")
        await until_status(rig, deliveries, [STATUS_WARNING, 0])
        rig.nodes.send(0x085, bytes(8))
        await deliveries.until(
            lambda: len(alarms(deliveries, "emergency")) == 2, "its end"
        )
        await until_status(rig, deliveries, [0, 0])
    assert alarms(deliveries, "emergency") == [(0, True), (0, False)]


async def test_alarms_of_the_profile_are_read_from_time_to_time():
    with CanRig(status_period_s=0.1) as rig, rig.driver:
        node = rig.nodes.nodes[9]
        deliveries = await streaming(rig)
        node.objects |= {(0x6503, 0): u16(1), (0x6505, 0): u16(1 << 4)}
        await until_status(rig, deliveries, [0, STATUS_ERROR | STATUS_WARNING])
        node.objects |= {(0x6503, 0): u16(0), (0x6505, 0): u16(0)}
        await until_status(rig, deliveries, [0, 0])
    alarms = [(a.raised, a.code, a.text) for a in deliveries.of(DeviceAlarm)]
    # Which of the two is read first after both have changed is chance.
    for raised, two in ((True, alarms[:2]), (False, alarms[2:])):
        assert sorted(two) == [
            (raised, "encoder_alarm", "node 9: position error (0001)"),
            (raised, "encoder_warning", "node 9: battery low (0010)"),
        ]


async def test_two_nodes_with_one_number_are_reported(rig: CanRig):
    with rig.driver:
        deliveries = await streaming(rig)
        await until_status(rig, deliveries, [0, 0])
        rig.nodes.nodes[5].doubles = True
        await until_status(rig, deliveries, [STATUS_ERROR | STATUS_LATE, 0])
    assert alarms(deliveries, "duplicate_node") == [(0, True)]


async def test_two_nodes_with_one_number_are_reported_at_the_start(rig: CanRig):
    rig.nodes.nodes[9].doubles = True
    with rig.driver:
        deliveries = await up(rig)
        await deliveries.until(
            lambda: alarms(deliveries, "duplicate_node"), "the alarm"
        )
    assert alarms(deliveries, "duplicate_node") == [(1, True)]


async def test_a_bus_that_is_off_is_reported_until_it_is_back(rig: CanRig):
    with rig.driver:
        deliveries = await streaming(rig)
        rig.nodes.send(0x040, bytes(8), error=True)
        await deliveries.until(lambda: alarms(deliveries, "bus_off"), "the alarm")
        rig.nodes.send(0x100, bytes(8), error=True)
        await deliveries.until(
            lambda: len(alarms(deliveries, "bus_off")) == 2, "its end"
        )
    assert alarms(deliveries, "bus_off") == [(None, True), (None, False)]


async def test_noise_on_the_bus_ends_nothing(rig: CanRig):
    random = Random(3)
    with rig.driver:
        deliveries = await streaming(rig)
        for _ in range(2000):
            node = random.choice([0, 5, 9, 17])
            service = random.choice([0x080, 0x180, 0x280, 0x580, 0x700, 0x780])
            n = random.randrange(9)
            rig.nodes.send(service + node, random.randbytes(n), random.random() < 0.1)
        async with asyncio.timeout(8):
            # Both answer again; other alarms caused by the noise stay active.
            while [bits & STATUS_MISSING for bits in last_status(deliveries)] != [0, 0]:
                await answered(rig, deliveries)
    assert all(
        "fault in the driver" not in lost.reason for lost in deliveries.of(DeviceLost)
    )
    counts = [
        row for block in deliveries.of(CountSamples) for row in block.counts.tolist()
    ]
    assert len(counts) == len(deliveries.seqs())
