import itertools

import pytest

from tests.drivers.canopen.fake_nodes import u16, u32
from tests.drivers.canopen.rig import CanRig, until_status
from traverse.drivers.base.values import (
    CountSamples,
    DeviceLost,
    DeviceUp,
    StreamStarted,
)
from traverse.testing.deliveries import Deliveries
from traverse.testing.driver_contract import (
    DriverContract,
    StreamContract,
    streaming,
    up,
)
from traverse.testing.waiting import until


class TestCanOpen(DriverContract, StreamContract):
    pass


async def test_nodes_are_set_up_in_the_portable_way(rig: CanRig):
    with rig.driver:
        await up(rig)
        # The nodes live in a thread of their own, which may be behind.
        await until(lambda: (0x000, b"\x01\x09") in rig.nodes.heard, "both are started")
        frames = [frame for frame in rig.nodes.heard if frame[0] in (0x000, 0x605)]
    lines = [data.hex(" ") for _, data in frames if len(data) == 2 or data[0] & 0x20]
    written = [line for line, _ in itertools.groupby(lines)]  # some twice, if slow
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
        deliveries = await up(rig)
    identity = deliveries.of(DeviceUp)[0].identity
    assert identity.counts_per_turn == (1 << 16, 4096)
    assert identity.moduli_counts == (1 << 28, 4096 * 16)
    assert not identity.latches
    assert identity.inputs == 0
    assert "5:5f-406-5" in identity.name


@pytest.mark.parametrize(("sequence", "bits"), [("cw", 4), ("ccw", 5)])
async def test_the_code_sequence_is_set_and_the_other_bits_stay(
    sequence: str, bits: int
):
    with CanRig(code_sequence=sequence) as rig:
        for node in rig.nodes.nodes.values():
            node.objects[(0x6000, 0)] = u16(5 if sequence == "cw" else 4)
            node.objects |= {(0x6001, 0): u32(4096), (0x6002, 0): u32(4096)}
        with rig.driver:
            await up(rig)
        assert rig.nodes.nodes[5].objects[(0x6000, 0)] == u16(bits)


async def test_all_that_is_wrong_at_the_start_is_told_together(rig: CanRig):
    rig.nodes.nodes[5].objects[(0x1000, 0)] = u32(0x0002_0191)
    rig.nodes.nodes[9].objects[(0x6501, 0)] = u32(0)
    with rig.driver:
        deliveries = Deliveries(rig.delivery_queue)
        await deliveries.until(lambda: deliveries.of(DeviceLost), "the refusal")
    (lost,) = deliveries.of(DeviceLost)
    assert "node 5 reports device profile 401, expected an encoder" in (lost.reason)
    assert "node 9 on" in lost.reason
    assert "0 counts per turn" in lost.reason


async def test_a_node_that_is_missing_at_the_start_is_named(rig: CanRig):
    rig.nodes.nodes[9].mute = True
    with rig.driver:
        deliveries = Deliveries(rig.delivery_queue)
        await deliveries.until(lambda: deliveries.of(DeviceLost), "the loss")
        (lost,) = deliveries.of(DeviceLost)
        assert f"nodes 9 on {rig.port} do not answer; nodes 5 do" in lost.reason
        rig.nodes.nodes[9].mute = False
        await deliveries.until(lambda: deliveries.of(DeviceUp), "both")


async def test_a_fixed_map_is_good_if_the_position_is_first(rig: CanRig):
    node = rig.nodes.nodes[5]
    node.refuses = {(0x1A00, 0), (0x1A00, 1)}
    node.objects |= {(0x1A00, 0): b"\x01", (0x1A00, 1): u32(0x6004_0020)}
    with rig.driver:
        deliveries = await streaming(rig)
        await until_status(rig, deliveries, [0, 0])


async def test_the_driver_sends_the_syncs_itself():
    with CanRig(sync="host") as rig, rig.driver:
        rig.nodes.answers_sync = True
        deliveries = await streaming(rig, 200.0)
        await deliveries.until(lambda: len(deliveries.seqs()) >= 50, "50 samples")
    blocks = deliveries.of(CountSamples)
    counts = [c for block in blocks for c in block.counts.tolist()]
    known = {tuple(c) for c in counts}
    assert known <= {(1000 + k, 1007 + k) for k in range(400)}  # of one SYNC each
    assert deliveries.of(StreamStarted)[0].rate_hz == 200.0


async def test_a_stream_can_be_stopped_and_begun_again(rig: CanRig):
    with rig.driver:
        deliveries = await streaming(rig)
        rig.emit(3)
        await deliveries.until(lambda: len(deliveries.seqs()) >= 3, "3 samples")
        rig.driver.request_stream(0.0)
        rig.driver.request_stream(100.0)
        await deliveries.until(
            lambda: len(deliveries.of(StreamStarted)) == 2, "another stream"
        )
        rig.emit(2)
        await deliveries.until(lambda: len(deliveries.seqs()) >= 5, "2 samples more")
    assert deliveries.seqs() == [0, 1, 2, 0, 1]
