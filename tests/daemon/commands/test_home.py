"""Homing: the counts of incremental encoders are set at a known posture."""

from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.board_harness import BOARD, Bench
from tests.daemon.values import ARM, arm_model, count_samples, latch
from traverse.daemon.commands.points import PointCommands
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.executor import HomeJoints
from traverse.daemon.references.memory import ReferenceMemory
from traverse.daemon.replay.restoring import restore
from traverse.drivers.base.values import DeviceUp
from traverse.protocol.messages import HomeArgs

HOME = {"J1": 1.3, "J2": -0.4, "J3": 0.2}
HOMED = ARM + "[home]\nangles_rad = { J1 = 1.3, J2 = -0.4, J3 = 0.2 }\n"
# J1 is on channel 2, J2 on 0 and J3 on 1.
TURNS = np.array([65536, 1 << 20, 1 << 23])
SIGNS = np.array([1, -1, 1])


def up(boot="1", *, restarted=False):
    return DeviceUp("base", replace(BOARD, boot=boot), restarted)


class Arm:
    """A board whose counts begin anywhere at each power-up."""

    def __init__(self, folder, text=HOMED, memory=None):
        self.bench = Bench(arm_model(folder, text))
        self.memory = memory or ReferenceMemory()
        self.bench.measurement.references.devices.memory = self.memory
        self.commands = PointCommands(self.bench.measurement)
        self.offset_rad = np.array([0.7, 2.9, -1.1])
        self._n = 0

    def at(self, angles_rad):
        counts = (np.array(angles_rad) + self.offset_rad) * SIGNS * TURNS / (2 * np.pi)
        by_channel = np.rint(counts)[[1, 2, 0]].astype(np.int64) % [
            1 << 32,
            1 << 23,
            1 << 20,
        ]
        self._n += 1
        now_ns = self.bench.clock.now_ns = 10**12 + self._n * 10**9
        first = 20 * self._n
        rows = np.tile(by_channel, (20, 1))
        start_ns = now_ns - (first + 20) * 10_000_000
        self.bench.take(count_samples(rows, first=first, start_ns=start_ns))
        self.bench.take(latch(tuple(by_channel.tolist()), now_ns=now_ns, token=self._n))
        return self.bench.points[-1]

    async def home(self, *joints):
        return await self.commands.home(HomeArgs(joints=joints or None))

    def close(self):
        self.bench.device.driver.close()


@pytest.fixture
async def arm(tmp_path):
    arm = Arm(tmp_path)
    arm.bench.take(up())
    yield arm
    arm.close()


RESOLUTION_RAD = 2 * np.pi / 65536


async def test_readings_are_those_of_the_posture_from_then_on(arm):
    doubtful = arm.at(list(HOME.values()))
    assert doubtful.quality.flags == ("turns_uncertain",)
    result = await arm.home()
    assert result["homed"] == ["J1", "J2", "J3"]
    assert result["confirmed"] == ["base"]
    point = arm.at(list(HOME.values()))
    assert point.quality.ok
    assert point.angles_rad == pytest.approx(tuple(HOME.values()), abs=1e-12)
    elsewhere = (2.1, -1.9, 0.9)
    assert arm.at(elsewhere).angles_rad == pytest.approx(elsewhere, abs=RESOLUTION_RAD)
    assert arm.bench.points[-1].counts == pytest.approx(point.counts, abs=2**22)


async def test_an_arm_that_moves_is_not_at_its_home_posture(arm):
    arm.at(list(HOME.values()))
    now_ns = arm.bench.clock.now_ns
    rows = np.linspace(100_000, 101_000, 20)[:, np.newaxis] * np.ones(3)
    moving = count_samples(np.rint(rows), first=200, start_ns=now_ns - 2 * 10**9)
    arm.bench.take(moving)
    arm.bench.clock.now_ns += 2 * 10**8
    with pytest.raises(CaptureRefusedError, match="mm/s; at the home posture it rests"):
        await arm.home()
    arm.at(list(HOME.values()))
    assert (await arm.home())["confirmed"] == ["base"]


async def test_some_joints_leave_the_others_in_doubt(arm):
    arm.at(list(HOME.values()))
    assert (await arm.home("J1", "J3"))["confirmed"] == []
    assert arm.at(list(HOME.values())).quality.flags == ("turns_uncertain",)
    assert (await arm.home("J2"))["confirmed"] == ["base"]
    point = arm.at(list(HOME.values()))
    assert point.quality.ok
    assert point.angles_rad == pytest.approx(tuple(HOME.values()), abs=1e-12)


async def test_it_lasts_until_the_power_is_lost(arm, tmp_path):
    arm.at(list(HOME.values()))
    await arm.home()
    before = arm.at((2.1, -1.9, 0.9))
    again = Arm(tmp_path, memory=arm.memory)
    again.bench.take(up())  # the same power-up, another start of the daemon
    after = again.at((2.1, -1.9, 0.9))
    assert after.quality.ok
    assert after.angles_rad == pytest.approx(before.angles_rad, abs=1e-12)
    again.offset_rad = np.zeros(3)
    again.bench.take(up("2", restarted=True))
    assert again.at((2.1, -1.9, 0.9)).quality.flags == ("turns_uncertain",)
    again.close()


async def test_another_home_posture_of_the_arm_file_has_to_be_homed_again(
    arm, tmp_path
):
    arm.at(list(HOME.values()))
    await arm.home()
    assert arm.at((2.1, -1.9, 0.9)).quality.ok
    text = HOMED.replace("J2 = -0.4", "J2 = -0.5")
    other = Arm(tmp_path, text, memory=arm.memory)
    other.bench.take(up())  # the same power-up, another start of the daemon
    assert other.at((2.1, -1.9, 0.9)).quality.flags == ("turns_uncertain",)
    other.close()

    measurement = arm.bench.measurement
    measurement.apply_settings(measurement.configuration, arm_model(tmp_path, text))
    assert arm.at((2.1, -1.9, 0.9)).quality.flags == ("turns_uncertain",)


async def test_homing_elsewhere_since_the_same_power_up_is_reported(arm):
    arm.at(list(HOME.values()))
    await arm.home()
    arm.at((1.3, -0.4, 0.205))
    await arm.home()
    assert "elsewhere" not in arm.bench.events[-1].text
    arm.at((1.3, -0.1, 0.205))
    await arm.home()
    assert "elsewhere than before since its power-up (J2 by -0.3" in (
        arm.bench.events[-1].text
    )


async def test_a_snapshot_continues_bit_for_bit(arm, tmp_path):
    arm.at(list(HOME.values()))
    await arm.home()
    state = arm.bench.measurement.snapshot()
    expected = arm.at((2.1, -1.9, 0.9))
    other = Arm(tmp_path)
    other._n = arm._n - 1
    restore(other.bench.measurement, {**state, "devices": [], "fresh": False})
    reading = other.at((2.1, -1.9, 0.9))
    assert reading.angles_rad == expected.angles_rad
    assert reading.xyz_mm == expected.xyz_mm
    other.close()


@pytest.mark.parametrize(
    ("text", "joints", "reason"),
    [
        (ARM, (), "has no home posture"),
        (HOMED, ("J9",), "has no angle of 'J9'"),
        (HOMED.replace("sign =", "absolute = true\nsign ="), (), "no joint of"),
        (HOMED.replace("sign =", "absolute = true\nsign ="), ("J1",), "is absolute"),
    ],
)
async def test_what_cannot_be_homed_is_refused(tmp_path, text, joints, reason):
    arm = Arm(tmp_path, text)
    arm.bench.take(up())
    arm.at(list(HOME.values()))
    with pytest.raises(CaptureRefusedError, match=reason) as refused:
        await HomeJoints(HomeArgs(joints=joints or None)).execute(arm.bench.measurement)
    assert refused.value.remedy
    arm.close()
