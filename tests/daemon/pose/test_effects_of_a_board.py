"""Effects with a board at the other end of a real line: its data reach them."""

import contextlib

import numpy as np
import pytest

from tests.daemon.commands.test_board_commands import CHANNELS, Bench
from tests.daemon.effect_entries import effect
from tests.daemon.pose.test_pipeline import probe_by_hand
from tests.daemon.values import ARM, arm_model
from tests.drivers.latch_board import frame_bodies as bodies
from tests.drivers.latch_board.fake_board import HELLO, FakeBoard
from traverse.daemon.startup_check import check_devices
from traverse.protocol.messages import PointArgs, Quality, ScanArgs
from traverse.testing.waiting import until


@contextlib.asynccontextmanager
async def measuring(folder, *effects):
    with FakeBoard(folder / "ttyBoard", counts=(1000, 2000, 3000)) as board:
        board.answers[HELLO] = lambda body: [bodies.hello(body[1], channels=CHANNELS)]
        bench = Bench(board, arm_model(folder, ARM + "".join(effects)))
        async with bench.running():
            assert await check_devices([bench.device]) == []
            bench.requests.request_tracking_rate()
            await until(bench.rates_hz, "the tracking stream")
            yield bench


async def captured(bench):
    await bench.point_requests.take_point(PointArgs())
    return bench.points[-1][0]


def doubts(point):
    """Flags, but for that of the time: a busy computer ties a clock late."""
    return set(point.quality.flags) - {"time_uncertain"}


async def moved(bench, n=10):
    """Let the board stream until so many samples more have been taken."""
    enough = bench.device.samples + n

    def streamed():
        bench.board.send(*bench.board.samples(1))
        return bench.device.samples >= enough

    await until(streamed, "the samples")


def off_mm(point, joint, d_alpha):
    """How far the point is from that of a reading which is wrong by this."""
    readings = np.array(point.angles_rad)
    readings[joint] -= d_alpha
    return np.linalg.norm(np.array(point.xyz_mm) - probe_by_hand(readings)[0])


async def test_the_boards_temperature_reaches_the_effects(tmp_path):
    warm = effect("encoder_temperature", joint='"J2"', rate_rad_c=1e-4)
    async with measuring(tmp_path, warm) as bench:
        await moved(bench)
        point = await captured(bench)
        assert doubts(point) == {"temperature_unknown"}
        assert point.temperature_c is None
        assert off_mm(point, 1, 0.0) < 1e-9
        bench.board.send(bodies.temperatures(bench.board.ticks(), 2750))
        await until(lambda: bench.device.temperatures_c, "the temperature")
        point = await captured(bench)
        assert (doubts(point), point.temperature_c) == (set(), 27.5)
        assert off_mm(point, 1, 7.5e-4) < 1e-9
        bench.board.send(bodies.temperatures(bench.board.ticks(), -32768))
        await until(lambda: bench.device.temperatures_c == (None,), "the loss")
        point = await captured(bench)
        assert doubts(point) == {"temperature_unknown"}


async def test_an_edge_is_corrected_by_the_sense_in_which_it_was_approached(tmp_path):
    play = effect("backlash", joint='"J1"', half_width_rad=4e-4)
    async with measuring(tmp_path, play) as bench:
        # On a busy machine the board's clock may not be tied yet, either.
        assert "motion_unknown" in (await captured(bench)).quality.flags
        begin = bench.board.counts
        await moved(bench)  # upwards, by a count a sample
        bench.board.counts = tuple(count + 1000 for count in begin)
        up = await captured(bench)
        bench.board.counts = begin
        bench.board.press()
        await until(lambda: len(bench.points) == 3, "the point of the button")
        back = bench.points[-1][0]
        assert doubts(up) == doubts(back) == set()
        assert (up.trigger, back.trigger) == ("command", "button")
        assert off_mm(up, 0, 4e-4) < 1e-9
        assert off_mm(back, 0, -4e-4) < 1e-9


@pytest.mark.parametrize(("year", "moved_mm"), [(2020, 5.0), (2200, 0.0)])
async def test_effects_bound_to_time_go_by_utc(tmp_path, year, moved_mm):
    knock = effect(
        "base_step",
        at_s=0.0,
        step_mm=[0.0, 0.0, 5.0],
        epoch_utc=f"{year}-01-01T00:00:00Z",
    )
    async with measuring(tmp_path, knock) as bench:
        await moved(bench)
        point = await captured(bench)
        assert off_mm(point, 0, 0.0) == pytest.approx(moved_mm, abs=1e-9)
        assert doubts(point) == set()


async def test_what_effects_say_stands_in_scans_and_live_poses(tmp_path):
    bent = effect("stylus_bending", compliance_mm_n=0.01)
    curve = {"knots": [-1.0, 0.0, 1.0], "values_rad": [0.0, 1e-6, 0.0]}
    curve["covariate"] = '"J2_speed_rad_s"'
    async with measuring(
        tmp_path, bent, effect("empirical", joint='"J2"', **curve)
    ) as bench:
        await bench.requests.change_scan(ScanArgs(action="start", rate_hz=100.0))
        await moved(bench)
        # The first sample has no speed and hence no covariance: a block of its own.
        await until(lambda: len(bench.scans) > 1, "the scan")
        first, *others = (
            Quality.from_bits(int(bits)).flags
            for scan in bench.scans
            for bits in scan.quality
        )
        assert set(others) == {("surface_unknown", "empirical")}
        assert first == ("surface_unknown", "empirical", "motion_unknown")
        assert bench.live[-1].quality == Quality(
            ok=False, flags=("surface_unknown", "empirical")
        )


async def test_a_point_before_any_stream_says_that_its_speed_is_unknown(tmp_path):
    """What the board's clock leaves open cannot be stated as a length then."""
    async with measuring(tmp_path) as bench:
        early = await captured(bench)
        # A busy machine may read it before the clock is tied.
        flags = set(early.quality.flags)
        assert {"motion_unknown"} <= flags <= {"motion_unknown", "time_uncertain"}
        assert early.covariance_mm2 is None
        await moved(bench)
        point = await captured(bench)
        assert doubts(point) == set()
        assert point.covariance_mm2 is not None
