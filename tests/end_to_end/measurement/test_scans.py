import asyncio

import numpy as np
import pytest

from tests.end_to_end.arm_matrices import MatrixArm
from tests.end_to_end.listener import Listener, numbers, times_ns
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import REST, SPHERE, SWEEP, Workbench
from traverse.protocol.messages import Scan, ScanArgs

pytestmark = pytest.mark.needs("mosquitto")

# At 10 kHz a board's buffer lasts 0.13 s, and a busy computer may stand still for
# longer: this one lasts for seconds.
ROOMY = "transmit_buffer_bytes = 2000000"
SETTLED_S = 1.0  # the host learns the board's clock in the first half second


async def scanned(listener: Listener, rate_hz: float, n: int) -> list[Scan]:
    await asyncio.sleep(SETTLED_S)
    scan = await listener.start_scan(rate_hz)
    await listener.scan_points(scan, n)
    return await listener.stop_scan(scan)


def assert_complete(blocks: list[Scan], rate_hz: float) -> None:
    """No number is missing, and the times are as far apart as the rate says."""
    seq, at_ns = numbers(blocks), times_ns(blocks)
    assert (seq == np.arange(blocks[-1].total or 0)).all()
    assert [b.last for b in blocks] == [False] * (len(blocks) - 1) + [True]
    assert (blocks[-1].lost, blocks[-1].dropped) == (0, 0)
    # The host's picture of the board's clock still settles by some milliseconds.
    span_s = (at_ns[-1] - at_ns[0]) * 1e-9
    assert span_s == pytest.approx((len(seq) - 1) / rate_hz, abs=0.015)
    assert (np.diff(at_ns) >= 0).all()


@pytest.mark.parametrize(
    "rate_hz", [333.3, pytest.param(10_000.0, marks=pytest.mark.slow)]
)
async def test_a_scan_is_complete_at_its_rate(bench: Workbench, rate_hz: float) -> None:
    bench.write_simulator(SWEEP, top="repeat = true", board=ROOMY)
    bench.write_daemon()
    async with measuring(bench) as (listener, _, _):
        blocks = await scanned(listener, rate_hz, int(rate_hz))
    assert_complete(blocks, rate_hz)
    assert len(numbers(blocks)) >= int(rate_hz)
    arm = MatrixArm(bench.arm_file)
    for block in blocks[:: max(1, len(blocks) // 20)]:
        if len(block.dtime_ns):
            assert block.counts is not None
            xyz_mm, shank = arm.pose(block.counts[0].tolist())
            assert block.xyz_mm[0] == pytest.approx(xyz_mm, abs=1e-9)
            assert block.ijk[0] == pytest.approx(shank, abs=1e-12)


async def test_a_slow_scan_keeps_following_fast_joints(bench: Workbench) -> None:
    bench.write_simulator(SPHERE.format(points=4), top="repeat = true")
    bench.write_daemon()
    async with measuring(bench) as (listener, _, _):
        blocks = await scanned(listener, 7.0, 10)
    assert_complete(blocks, 7.0)
    arm = MatrixArm(bench.arm_file)
    for block in blocks:
        for counts, xyz_mm in zip(block.counts, block.xyz_mm, strict=True):
            assert xyz_mm == pytest.approx(arm.pose(counts.tolist())[0], abs=1e-9)


async def test_a_rate_beyond_the_board_is_refused(bench: Workbench) -> None:
    bench.write_simulator(REST, board="max_rate_hz = 2000.0")
    bench.write_daemon()
    async with measuring(bench) as (listener, _, _):
        refused = await listener.command(ScanArgs(action="start", rate_hz=2200.0))
        nearly = await listener.command(ScanArgs(action="start", rate_hz=2001.0))
        blocks = await scanned(listener, 2000.0, 1000)
    assert refused.error is not None
    assert refused.error.code == "scan.rate"
    assert "2000" in refused.error.text
    assert nearly.result is not None
    assert nearly.result["rate_hz"] == 2000.0  # the possible one, and it is stated
    assert_complete(blocks, 2000.0)
