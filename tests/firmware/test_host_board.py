import numpy as np
import pytest

from tests.firmware.host_rig import HostBoard, HostBoardRig
from traverse.drivers.base.values import (
    CountSamples,
    DeviceAlarm,
    DeviceFault,
    DeviceTemperatures,
    DeviceUp,
    LatchedCounts,
)
from traverse.testing.driver_contract import (
    DriverContract,
    KeptEdgeContract,
    LatchContract,
    StreamContract,
    streaming,
    up,
)

pytestmark = pytest.mark.needs("compiler")


@pytest.fixture
async def rig(tmp_path):
    # The counter wraps half a second after power-up.
    first_ticks = str(2**32 - 500_000)
    with HostBoard(tmp_path / "port", "--first-ticks", first_ticks) as board:
        rig = HostBoardRig(board)
        yield rig
        rig.driver.close()


class TestHostBoardContract(
    DriverContract, StreamContract, KeptEdgeContract, LatchContract
):
    parts = (1, 7, 40)


async def test_a_press_has_the_counts_of_its_first_contact(rig):
    rig.board.do("count 0 1000", "turn 3 -123456")
    with rig.driver:
        deliveries = await up(rig)
        rig.press()
        rig.board.do("count 0 2000")
        await deliveries.until(lambda: deliveries.of(LatchedCounts), "the press")
    (latch,) = deliveries.of(LatchedCounts)
    assert (latch.input, latch.counts[0], len(latch.counts)) == (0, 1000, 7)


async def test_a_loss_of_power_is_noticed(rig):
    with rig.driver:
        deliveries = await streaming(rig)
        rig.press()
        await deliveries.until(lambda: deliveries.of(LatchedCounts), "an edge")
        rig.board.do("power")
        await deliveries.until(lambda: len(deliveries.of(DeviceUp)) == 2, "it is back")
    assert [up.restarted for up in deliveries.of(DeviceUp)] == [False, True]


async def test_10_khz_without_a_loss_over_the_wrap_of_ticks(rig):
    rig.board.do("turn 0 10000")
    with rig.driver:
        deliveries = await streaming(rig, 10_000.0)
        await deliveries.until(
            lambda: len(deliveries.seqs()) > 8000, "0.8 s of samples"
        )
    blocks = deliveries.of(CountSamples)
    ticks = np.concatenate([block.device_ticks for block in blocks])
    assert deliveries.seqs() == list(range(len(ticks)))
    assert set(np.diff(ticks)) == {100}
    counts = np.concatenate([block.counts[:, 0] for block in blocks])
    assert set(np.diff(counts)) == {1}
    assert deliveries.of(DeviceFault) == []


async def test_temperatures_and_alarms_arrive(rig):
    rig.board.do("temperature 0 -1234", "alarm 2 1 1 350")
    with rig.driver:
        deliveries = await up(rig)
        rig.board.do("alarm 2 0 1 900")
        await deliveries.until(lambda: deliveries.of(DeviceAlarm), "the alarm")
        await deliveries.until(
            lambda: deliveries.of(DeviceTemperatures), "temperatures"
        )
    alarm = deliveries.of(DeviceAlarm)[-1]
    assert (alarm.channel, alarm.raised, alarm.code, alarm.value) == (2, False, 1, 900)
    assert deliveries.of(DeviceTemperatures)[0].values_c == (-12.34, None)
