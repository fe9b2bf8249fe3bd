import asyncio
import contextlib
import itertools
from collections.abc import AsyncIterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.drivers.simulated_peer import SimulatedPeer
from tests.simulator.one_hinge import mounted
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import (
    STATUS_MISSING,
    CountSamples,
    DeviceAlarm,
    DeviceFault,
    DeviceUp,
)
from traverse.drivers.canopen.driver import CanOpenDriver
from traverse.drivers.canopen.options import CanOpenOptions
from traverse.simulator.devices.canopen.device import CanOpenBus
from traverse.simulator.devices.canopen.table import CanOpenTable
from traverse.testing.driver_contract import streaming, up

names = itertools.count()
BOTH = {"nodes": (5, 9)}


@contextlib.asynccontextmanager
async def played(
    tmp_path, *faults, interface="virtual", **keys
) -> AsyncIterator[SimpleNamespace]:
    if interface == "slcan":
        where, channel = {"port": "can"}, str(tmp_path / "can")
    else:
        channel = f"simulated-{next(names)}"
        where = {"channel": channel}
    table = CanOpenTable(
        kind="canopen", id="arm", interface=interface, **BOTH, **where, **keys
    )
    mounting = mounted(tmp_path, table, *faults)
    mounting.clock.begin_s = None  # faults count from the first SYNC
    options = CanOpenOptions(
        channel=channel,
        interface=interface,
        heartbeat_ms=100,
        status_period_s=0.2,
        **BOTH,
    )
    queue = DeliveryQueue(asyncio.get_running_loop())
    peer = SimulatedPeer(Path(channel), lambda: CanOpenBus(table, mounting), mounting)
    with peer, CanOpenDriver("arm", options, queue) as driver:
        yield SimpleNamespace(delivery_queue=queue, driver=driver, port="", peer=peer)


@pytest.mark.parametrize("interface", ["virtual", "slcan"])
async def test_samples_are_what_the_encoders_latched(tmp_path, interface):
    async with played(tmp_path, interface=interface) as rig:
        deliveries = await streaming(rig, 100.0)
        await deliveries.until(lambda: len(deliveries.seqs()) >= 40, "40 samples")
        noted = list(rig.peer.device.mounting.notes.readings)
    identity = deliveries.of(DeviceUp)[0].identity
    assert identity.counts_per_turn == (65536, 65536)
    latched = {}
    for _, channel, time_s, count, _ in noted:
        latched.setdefault(time_s, {})[channel] = count
    truth = {(pair[0], pair[1]) for pair in latched.values() if len(pair) == 2}
    for block in deliveries.of(CountSamples):
        is_complete = (block.status == 0).all(axis=1)
        assert {tuple(row) for row in block.counts[is_complete].tolist()} <= truth


async def test_a_node_that_resets_and_an_emergency_are_reported(tmp_path):
    faults = (
        {"kind": "reset", "channel": 1, "at_s": 0.3, "duration_s": 0.6},
        {"kind": "emcy", "channel": 0, "at_s": 0.2, "duration_s": 0.5},
    )
    async with played(tmp_path, *faults) as rig:
        deliveries = await streaming(rig, 100.0)
        await deliveries.until(
            lambda: ended(deliveries, "node_lost"), "the node is back"
        )
        await deliveries.until(
            lambda: ended(deliveries, "emergency"), "the error is over"
        )
        await deliveries.until(lambda: last_status(deliveries) == [0, 0], "all is well")
    alarms = [(a.code, a.channel) for a in deliveries.of(DeviceAlarm) if a.raised]
    assert ("node_lost", 1) in alarms
    assert ("emergency", 0) in alarms
    assert ("encoder_alarm", 0) in alarms  # its object 6503 was read
    codes = [fault.code for fault in deliveries.of(DeviceFault)]
    assert codes.count("node_restarted") == 1
    states = {
        tuple(row)
        for block in deliveries.of(CountSamples)
        for row in block.status.tolist()
    }
    assert any(
        row[1] & STATUS_MISSING and not row[0] & STATUS_MISSING for row in states
    )


async def test_a_bus_that_goes_off_returns(tmp_path):
    off = {"kind": "bus_off", "at_s": 0.2, "duration_s": 0.15}
    async with played(tmp_path, off) as rig:
        deliveries = await streaming(rig, 100.0)
        await deliveries.until(lambda: ended(deliveries, "bus_off"), "it is back")
        await deliveries.until(lambda: lost_samples(deliveries), "what was lost")


async def test_an_encoder_that_says_another_resolution_is_seen(tmp_path):
    keys = {"told_counts_per_turn": (65536, 4096)}
    async with played(tmp_path, **keys) as rig:
        deliveries = await up(rig)
    (ups,) = deliveries.of(DeviceUp)
    assert ups.identity.counts_per_turn == (65536, 4096)


def lost_samples(deliveries):
    return [f for f in deliveries.of(DeviceFault) if f.code == "samples_lost"]


def ended(deliveries, code):
    return any(a.code == code and not a.raised for a in deliveries.of(DeviceAlarm))


def last_status(deliveries):
    return deliveries.of(CountSamples)[-1].status[-1].tolist()
