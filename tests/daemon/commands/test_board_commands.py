"""Commands and buttons with a board at the other end of a real line."""

import asyncio
import contextlib

import pytest

from tests.daemon.values import arm_model, configuration, kept_at_once
from tests.drivers.latch_board import frame_bodies as bodies
from tests.drivers.latch_board.fake_board import HELLO, START, FakeBoard
from tests.established import confirmed
from traverse.daemon.acquisition.device import open_device
from traverse.daemon.clock import HostClock
from traverse.daemon.commands.points import PointCommands
from traverse.daemon.commands.scans import ScanCommands
from traverse.daemon.config.devices import DeviceSection
from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.inputs import REFUSED, UNREACHABLE
from traverse.daemon.measurement import Measurement, Sinks
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.startup_check import check_devices
from traverse.drivers.base.values import Identity
from traverse.protocol.messages import PointArgs, ScanArgs
from traverse.testing.waiting import until

CHANNELS = ((32, 0), (23, 1 << 23), (20, 1 << 20))
MODULI = (1 << 32, 1 << 23, 1 << 20)
IDENTITY = Identity(
    "", "", MODULI, 0, 0.0, serials=(bodies.BOARD_ID.hex(),), boot="deadbeef"
)


class Bench:
    def __init__(self, board: FakeBoard, model) -> None:
        clock = HostClock()
        self.board = board
        self.room = True
        self.points, self.scans, self.events, self.live = [], [], [], []
        self.device = open_device(
            DeviceSection.from_table(
                {"id": "base", "driver": "latch-board", "port": str(board.link)}
            ),
            asyncio.get_running_loop(),
        )
        self.measurement = Measurement(
            configuration("base", inputs={"base/0": "button"}),
            model,
            Sinks(
                EventLog(clock, self.events.append),
                kept_at_once(self.offer),
                lambda scan, _: not self.scans.append(scan),
                self.live.append,
                references=confirmed(model, {"base": IDENTITY}),
            ),
            clock,
            devices=[self.device],
        )
        self.scanner = self.measurement.scanner
        self.requests = ScanCommands(self.measurement)
        self.point_requests = PointCommands(self.measurement)

    def offer(self, point):
        # What the board still keeps while the point is handed over.
        if self.room:
            self.points.append((point, set(self.board.edges)))
        return self.room

    @contextlib.asynccontextmanager
    async def running(self):
        task = asyncio.create_task(self.consume())
        try:
            self.device.driver.start()
            yield self
        finally:
            await asyncio.to_thread(self.device.driver.close)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    async def consume(self):
        while True:
            for delivery in await self.device.delivery_queue.take():
                self.measurement.dispatch(self.device, delivery)

    def rates_hz(self):
        started = self.board.heard(START)
        return [int.from_bytes(body[2:6], "little") / 1000 for body in started]


@pytest.fixture
async def bench(tmp_path):
    with FakeBoard(tmp_path / "ttyBoard", counts=(1000, 2000, 3000)) as board:
        board.answers[HELLO] = lambda body: [bodies.hello(body[1], channels=CHANNELS)]
        bench = Bench(board, arm_model(tmp_path))
        async with bench.running():
            assert await check_devices([bench.device]) == []
            bench.requests.request_tracking_rate()
            await until(bench.rates_hz, "the tracking stream")
            yield bench


async def test_the_joints_are_tracked_when_nothing_else_is_asked(bench):
    assert bench.rates_hz() == [100.0]


async def test_a_point_on_request_tells_its_number(bench):
    result = await bench.point_requests.take_point(PointArgs())
    ((point, _),) = bench.points
    assert result == {"session": point.session, "seq": 0, "id": point.id}
    assert (await bench.point_requests.take_point(PointArgs()))["seq"] == 1


async def test_an_edge_is_acknowledged_only_after_its_point_is_taken(bench):
    seq = bench.board.press()
    await until(lambda: bench.points, "the point")
    await until(lambda: not bench.board.edges, "the acknowledgement")
    ((point, kept),) = bench.points
    assert point.trigger == "button"
    assert kept == {seq}


async def test_a_refused_point_is_told_to_whoever_asked(bench):
    bench.room = False
    with pytest.raises(RequestRefusedError, match="so many points wait for the disk"):
        await bench.point_requests.take_point(PointArgs())


async def test_a_scan_begins_ends_and_goes_back_to_tracking(bench):
    begun = await bench.requests.change_scan(ScanArgs(action="start", rate_hz=40.0))
    assert (begun["rate_hz"], begun["device_rate_hz"]) == (40.0, 120.0)
    bench.board.send(*bench.board.samples(10))
    await until(lambda: sum(len(m.xyz_mm) for m in bench.scans) == 4, "4 points")
    ended = await bench.requests.change_scan(ScanArgs(action="stop"))
    assert ended == {"scan": begun["scan"], "total": 4}
    await until(lambda: len(bench.rates_hz()) == 3, "the tracking stream")
    assert bench.rates_hz() == [100.0, 120.0, 100.0]
    again = await bench.requests.change_scan(ScanArgs(action="stop"))
    assert again == {"scan": None, "total": 0}


async def test_a_start_replaces_a_running_scan(bench):
    first = await bench.requests.change_scan(ScanArgs(action="start", rate_hz=200.0))
    second = await bench.requests.change_scan(ScanArgs(action="start", rate_hz=300.0))
    assert first["scan"] != second["scan"]
    assert [(m.scan, m.last) for m in bench.scans] == [(first["scan"], True)]
    assert bench.scanner.plan.id == second["scan"]


async def test_too_fast_a_scan_is_refused_and_the_running_one_continues(bench):
    begun = await bench.requests.change_scan(ScanArgs(action="start", rate_hz=200.0))
    slower = configuration("base", capture={"scan_max_rate_hz": 500.0})
    bench.measurement.apply_settings(slower, bench.measurement.model)
    with pytest.raises(RequestRefusedError, match="1000 Hz is more than the 500 Hz"):
        await bench.requests.change_scan(ScanArgs(action="start", rate_hz=1000.0))
    assert bench.scanner.plan.id == begun["scan"]


async def test_a_scan_that_the_board_refuses_ends_in_tracking(bench):
    good = bench.board.answers[START]

    def only_slow(body):
        rate = int.from_bytes(body[2:6], "little")
        fast = [bodies.reply(START, body[1], 3, 150_000)]
        return fast if rate > 150_000 else good(body)

    bench.board.answers[START] = only_slow
    with pytest.raises(RequestRefusedError, match="did not begin to stream"):
        await bench.requests.change_scan(ScanArgs(action="start", rate_hz=200.0))
    await until(lambda: bench.rates_hz()[-1] == 100.0, "the tracking stream")
    assert bench.scanner.plan is None
    assert "device.request_refused" in [event.code for event in bench.events]
    assert bench.device.state == "ready"


async def test_scans_by_distance_read_densely(bench):
    args = ScanArgs(action="start", mode="distance", spacing_mm=1.0)
    begun = await bench.requests.change_scan(args)
    assert (begun["rate_hz"], begun["device_rate_hz"]) == (1000.0, 1000.0)
    assert bench.scanner.plan.mode == "distance"


async def test_a_held_scan_needs_a_button(bench):
    bench.measurement.apply_settings(configuration("base"), bench.measurement.model)
    with pytest.raises(RequestRefusedError, match="no input") as caught:
        await bench.requests.change_scan(ScanArgs(action="start", held=True))
    assert caught.value.code == "scan.no_button"


async def test_a_lost_device_refuses_commands_and_a_scan_outlives_it(bench):
    await bench.requests.change_scan(ScanArgs(action="start", rate_hz=200.0))
    bench.board.send(*bench.board.samples(10))
    await until(lambda: bench.scans, "points")
    bench.board.unplug()
    await until(lambda: bench.device.state == "lost", "the loss")
    with pytest.raises(RequestRefusedError, match="base cannot measure"):
        await bench.point_requests.take_point(PointArgs())
    bench.board.plug()
    await until(lambda: len(bench.rates_hz()) == 3, "the scan's stream")
    bench.board.send(*bench.board.samples(10))
    await until(lambda: bench.scans[-1].seq >= 10, "points after the outage")
    # Those before are two blocks where the board's clock was not known at first.
    first = bench.scans[0]
    second = next(scan for scan in bench.scans if scan.seq >= 10)
    assert second.scan == first.scan
    outage = round((second.time_ns - first.time_ns) * 1e-9 * 200.0)
    assert second.seq == pytest.approx(outage, abs=20)
    assert second.lost == second.seq - 10


async def test_a_device_that_is_not_there_is_reported_at_start(tmp_path):
    board = FakeBoard(tmp_path / "ttyNone")
    async with Bench(board, arm_model(tmp_path)).running() as bench:
        ((status, text),) = await check_devices([bench.device])
    assert status == UNREACHABLE
    assert text.startswith("device base: cannot open")


async def test_a_device_that_does_not_fit_is_reported_at_start(tmp_path):
    with FakeBoard(tmp_path / "ttyBoard") as board:
        async with Bench(board, arm_model(tmp_path)).running() as bench:
            failures = await check_devices([bench.device])
    assert [status for status, _ in failures] == [REFUSED] * 2
    assert "2 channels, from 0" in failures[0][1]
