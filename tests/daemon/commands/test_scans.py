import asyncio

import pytest

from tests.daemon.arm_harness import ArmBench
from tests.daemon.two_devices import BEGIN_NS, base, wrist
from traverse.daemon.commands.scans import ScanCommands
from traverse.daemon.errors import RequestRefusedError
from traverse.drivers.base.values import DeviceLost, StreamStarted
from traverse.protocol.messages import PointArgs, ScanArgs


@pytest.fixture
async def bench(tmp_path):
    bench = ArmBench(tmp_path)
    bench.up()
    bench.take(wrist().samples(range(20)), base().samples(range(20)))
    yield bench
    bench.close()


@pytest.fixture
def requests(bench):
    return ScanCommands(bench.measurement)


@pytest.fixture
def point_requests(bench):
    return bench.point_requests


def rates_hz(bench):
    return {name: device.driver.rates_hz for name, device in bench.devices.items()}


async def test_a_point_on_request_comes_out_of_the_stream(bench, point_requests):
    bench.clock.now_ns = BEGIN_NS + 300_000_000
    asking = asyncio.create_task(point_requests.take_point(PointArgs()))
    await asyncio.sleep(0)
    assert not asking.done()
    bench.take(wrist().samples(range(20, 40)), base().samples(range(20, 40)))
    result = await asking
    (point,) = bench.points
    assert result == {"session": point.session, "seq": 0, "id": point.id}
    assert point.time_ns == BEGIN_NS + 300_000_000 + bench.clock.offset_ns


async def test_a_point_that_cannot_be_told_is_refused_with_the_reason(
    bench, point_requests
):
    bench.clock.now_ns = BEGIN_NS + 300_000_000
    asking = asyncio.create_task(point_requests.take_point(PointArgs()))
    await asyncio.sleep(0)
    bench.later(0.6)
    with pytest.raises(
        RequestRefusedError, match="no readings of base arrived after it"
    ) as refusal:
        await asking
    assert refusal.value.code == "capture.refused"
    assert refusal.value.remedy


async def test_no_command_is_taken_while_one_of_the_devices_is_away(
    bench, requests, point_requests
):
    bench.take(DeviceLost("wrist", "unplugged", "plug it in"))
    for command in (
        point_requests.take_point(PointArgs()),
        requests.change_scan(ScanArgs(action="start", rate_hz=50.0)),
    ):
        with pytest.raises(
            RequestRefusedError, match="wrist cannot measure: unplugged"
        ):
            await command


async def test_a_scan_waits_for_the_clock_device_and_asks_each_what_it_can(
    bench, requests
):
    asking = asyncio.create_task(
        requests.change_scan(ScanArgs(action="start", rate_hz=500.0))
    )
    await asyncio.sleep(0)
    assert rates_hz(bench) == {"base": [500.0], "wrist": [80.0], "handle": []}
    bench.take(StreamStarted("wrist", 2, 80.0))
    await asyncio.sleep(0)
    assert not asking.done()
    bench.take(StreamStarted("base", 2, 500.0))
    assert (await asking)["device_rate_hz"] == 500.0
    assert (await requests.change_scan(ScanArgs(action="stop")))["total"] == 0
    assert rates_hz(bench) == {
        "base": [500.0, 100.0],
        "wrist": [80.0, 80.0],
        "handle": [],
    }


async def test_the_clock_device_limits_the_rate_of_a_scan(bench, requests):
    with pytest.raises(
        RequestRefusedError, match="2000 Hz is more than the 1000 Hz possible"
    ):
        await requests.change_scan(ScanArgs(action="start", rate_hz=2000.0))
