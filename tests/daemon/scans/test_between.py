"""Scans of an arm whose clock device reads one encoder after the other."""

import asyncio
import contextlib
from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.daemon.arm_harness import IDENTITIES, ArmBench, edge
from tests.daemon.two_devices import BEGIN_NS, base, true_counts, wrist
from traverse.daemon.commands.scans import ScanCommands
from traverse.drivers.base.values import DeviceUp, StreamStarted
from traverse.protocol.messages import QualityFlag, ScanArgs
from traverse.protocol.messages.quality import flag_names

READ_HZ, SCAN_HZ = 32.0, 20.0
PERIOD_NS, STEP_NS = 31_250_000, 50_000_000
LINE = replace(
    IDENTITIES["base"], latches=False, max_rate_hz=READ_HZ, reads_in_turn=True
)
SKEW_NS = (1_000_000, 9_000_000, 17_000_000)
FIRST_NS = BEGIN_NS + 10 * PERIOD_NS  # of the scan's stream
FROZEN_S = 1.2


QUICK_WRIST = replace(IDENTITIES["wrist"], max_rate_hz=500.0)


@contextlib.contextmanager
def arm_bench(folder, **assembly):
    bench = ArmBench(folder, **assembly)
    bench.up("handle")
    bench.take(
        DeviceUp("base", LINE, False),
        StreamStarted("base", 1, READ_HZ),
        DeviceUp("wrist", QUICK_WRIST, False),
        StreamStarted("wrist", 1, 80.0),
    )
    yield bench
    bench.close()


@pytest.fixture
async def bench(tmp_path):
    with arm_bench(tmp_path) as bench:
        yield bench


@dataclass
class Arm:
    """Delivers samples of both devices as they come; J1 may freeze, or jump."""

    bench: ArmBench
    speed: float = 1.0
    frozen_s: float = np.inf
    jump_s: float = np.inf
    jump_rad: float = 0.0
    n_others: int = 0
    most_others: int = 10_000

    def read(self, stream, first_ns, numbers):
        reader = base(
            rate_hz=READ_HZ,
            skew_ns=SKEW_NS,
            stream=stream,
            first_ns=first_ns,
            speed=self.speed,
        )
        for number in numbers:
            samples = reader.samples([number])
            read_s = int(reader.reading_times_ns([number], 0)[0] - BEGIN_NS) * 1e-9
            at_ns = BEGIN_NS + round(min(read_s, self.frozen_s) * 1e9)
            count = round(float(true_counts(at_ns, self.speed)[0]))
            if read_s > self.jump_s:
                count += round(self.jump_rad * 65536 / (2 * np.pi))
            samples.counts[0, 2] = count % 65536
            self.bench.clock.now_ns = int(samples.sample_time_ns[0]) + PERIOD_NS
            n = (self.bench.clock.now_ns - BEGIN_NS) * 80 // 10**9
            n = min(n, self.most_others)
            if n > self.n_others:
                others = wrist(speed=self.speed).samples(range(self.n_others, n))
                self.bench.take(others)
                self.n_others = n
            self.bench.take(samples)


async def started(bench):
    """Start a scan, whose stream is number 2; return the answer."""
    commands = ScanCommands(bench.measurement)
    args = ScanArgs(action="start", rate_hz=SCAN_HZ)
    asking = asyncio.create_task(commands.change_scan(args))
    await asyncio.sleep(0)
    device_hz = bench.devices["base"].driver.rates_hz[-1]
    bench.take(StreamStarted("base", 2, device_hz))
    return await asking


async def scanned(bench, arm, n):
    """Scan for n samples of the stream, after others; return the blocks."""
    arm.read(1, BEGIN_NS, range(10))
    await started(bench)
    arm.read(2, FIRST_NS, range(n))
    bench.measurement.scanner.stop()
    return [message for message in bench.scans if len(message.xyz_mm)]


async def test_the_line_is_read_as_often_as_without_a_scan(bench):
    begun = await started(bench)
    assert (begun["rate_hz"], begun["device_rate_hz"]) == (SCAN_HZ, READ_HZ)
    # The other device, which is interpolated anyway, has the tracking rate.
    assert bench.devices["wrist"].driver.rates_hz == [100.0]


async def test_samples_have_the_rate_of_the_scan_and_the_arms_place_then(bench):
    blocks = await scanned(bench, Arm(bench), 65)
    times_ns = np.concatenate([m.time_ns + m.dtime_ns for m in blocks])
    times_ns = times_ns - bench.clock.offset_ns
    # 64 steps of the stream are 2 s.
    assert len(times_ns) in (40, 41)
    steps_ns = STEP_NS * np.arange(len(times_ns))
    assert times_ns.tolist() == (FIRST_NS + steps_ns).tolist()
    assert [m.rate_hz for m in blocks] == [SCAN_HZ] * len(blocks)
    last = bench.scans[-1]
    assert (last.last, last.total, last.lost) == (True, len(times_ns), 0)
    turns, signs = np.array([1 << 16, 1 << 20, 1 << 23]), np.array([1, -1, 1])
    expected_rad = signs * true_counts(times_ns) * 2 * np.pi / turns
    angles_rad = np.concatenate([m.angles_rad for m in blocks])
    off_rad = (angles_rad - expected_rad + np.pi) % (2 * np.pi) - np.pi
    # Linear interpolation leaves out f'' h^2 / 8 at most, of a sine.
    greatest_rad_s2 = np.array([0.4, 3.0, 1.2]) * np.square([1.1, 0.9, 2.3])
    left_out_rad = greatest_rad_s2 * (PERIOD_NS * 1e-9) ** 2 / 8
    assert (np.abs(off_rad) <= left_out_rad + 2 * np.pi / turns).all()
    quality = np.concatenate([m.quality for m in blocks])
    assert (quality & QualityFlag.INTERPOLATED).all()


async def test_a_sample_is_what_a_point_at_its_instant_is(bench):
    arm = Arm(bench)
    arm.read(1, BEGIN_NS, range(10))
    await started(bench)
    arm.read(2, FIRST_NS, range(20))
    bench.clock.now_ns = instant_ns = FIRST_NS + 13 * STEP_NS
    bench.take(edge("handle", instant_ns))
    arm.read(2, FIRST_NS, range(20, 30))
    bench.take(edge("handle", instant_ns + 3 * STEP_NS, active=False))
    bench.later(1.0)
    bench.measurement.scanner.stop()
    (point,) = bench.points
    assert point.time_ns == instant_ns + bench.clock.offset_ns
    (block,) = (m for m in bench.scans if m.seq <= 13 < m.seq + len(m.xyz_mm))
    row = 13 - block.seq
    assert tuple(block.xyz_mm[row]) == tuple(point.xyz_mm)
    assert tuple(block.covariance_mm2[row]) == tuple(point.covariance_mm2)
    assert flag_names(int(block.quality[row])) == point.quality.flags


async def test_a_count_that_freezes_within_a_slow_scan_is_seen(bench):
    blocks = await scanned(bench, Arm(bench, speed=2.0, frozen_s=FROZEN_S), 60)
    shown = [e for e in bench.events if e.code == "condition.channels" and e.active]
    assert len(shown) == 1
    assert "J1 (base/2)" in shown[0].text
    begin_ns = bench.clock.offset_ns + BEGIN_NS
    from_s, until_s = (
        (int(shown[0].data[name]) - begin_ns) * 1e-9 for name in ("from_ns", "until_ns")
    )
    assert FROZEN_S - PERIOD_NS * 1e-9 <= from_s <= FROZEN_S
    assert until_s - FROZEN_S < 0.3
    at_s = np.concatenate([m.time_ns + m.dtime_ns - begin_ns for m in blocks]) * 1e-9
    are_stale = np.concatenate([m.quality & QualityFlag.STALE for m in blocks]) > 0
    assert are_stale[at_s > until_s].all()
    assert not are_stale[at_s < FROZEN_S].any()


@pytest.mark.parametrize(("jump_rad", "is_seen"), [(0.06, True), (0.05, False)])
async def test_a_count_that_jumps_within_a_slow_scan_is_seen(bench, jump_rad, is_seen):
    """What shows at 32 Hz does: 5 mrad + 50 / 32^2 + 8 counts are 54.6 mrad.

    At 20 Hz it would be 131 mrad.
    """
    await scanned(bench, Arm(bench, jump_s=FROZEN_S, jump_rad=jump_rad), 60)
    doubts = [e for e in bench.events if e.code == "device.turns_uncertain"]
    assert bool(doubts) == is_seen
    if is_seen:
        assert f"J1 by {jump_rad:.2f} rad" in doubts[0].text


async def test_samples_are_lost_with_those_of_the_stream(bench):
    arm = Arm(bench)
    arm.read(1, BEGIN_NS, range(10))
    await started(bench)
    arm.read(2, FIRST_NS, range(20))
    # 20 to 23 are missing: instants 594 to 750 ms after the first, which are 12 to 15.
    arm.read(2, FIRST_NS, range(24, 40))
    bench.measurement.scanner.stop()
    numbers = [m.seq + k for m in bench.scans for k in range(len(m.xyz_mm))]
    assert numbers[:12] == list(range(12))
    assert numbers[12] == 15  # of 750 ms, when sample 24 is
    assert (bench.scans[-1].lost, bench.scans[-1].total) == (3, numbers[-1] + 1)


@pytest.mark.parametrize("policy", ["flag", "drop"])
async def test_samples_without_readings_are_marked_or_left_out(tmp_path, policy):
    with arm_bench(tmp_path, policy=policy) as bench:
        arm = Arm(bench, most_others=80)  # the wrist is silent after 79 / 80 s
        arm.read(1, BEGIN_NS, range(10))
        await started(bench)
        arm.read(2, FIRST_NS, range(30))
        bench.later(1.0)
        bench.measurement.scanner.stop()
    last_s = 79 / 80 - 10 * PERIOD_NS * 1e-9  # after the first sample: 0.675 s
    n_good = 1 + int(last_s / (STEP_NS * 1e-9))
    numbers = [m.seq + k for m in bench.scans for k in range(len(m.xyz_mm))]
    quality = np.concatenate([m.quality for m in bench.scans])
    lack = int(QualityFlag.LATE | QualityFlag.INCOMPLETE)
    assert numbers[:n_good] == list(range(n_good))
    assert not (quality[:n_good] & lack).any()
    if policy == "drop":
        assert len(numbers) == n_good
    else:  # until the line's last sample, 29 steps after the first
        assert numbers == list(range(1 + 29 * PERIOD_NS // STEP_NS))
        assert (quality[n_good:] & lack).all()
