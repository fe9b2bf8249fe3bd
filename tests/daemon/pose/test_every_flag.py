"""Each documented flag, and a cause in the simulated arm that sets it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.arm_harness import ArmBench, edge
from tests.daemon.board_harness import BOARD, Bench
from tests.daemon.effect_entries import FIRST_UTC, effect
from tests.daemon.two_devices import BEGIN_NS, base
from tests.daemon.values import ARM, SetClock, arm_file, arm_model, count_samples, latch
from traverse.daemon.config.schema import EndStopSection, QualitySection
from traverse.daemon.pose.arm_model import read_model
from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_STALE,
    DeviceAlarm,
    DeviceTemperatures,
    DeviceUp,
)
from traverse.protocol.messages import FLAG_MEANINGS, QualityFlag

UP = DeviceUp("base", BOARD, False)
POWER_LOST = replace(UP, restarted=True)
HERE = (1000, 1000, 1000)
CURVE = {"joint": '"J2"', "knots": [-1.0, 1.0], "values_rad": [0.0, 1e-4]}


def at_rest(n=20, status=0):
    samples = count_samples(np.full((n, 3), 1000))
    return replace(samples, status=np.full((n, 3), status, np.uint8))


def turning(per_sample):
    """Twenty samples, 10 ms apart, of an arm all of whose joints turn."""
    return count_samples(1000 + np.outer(np.arange(20), (per_sample,) * 3))


def press(status=0, token=0):
    at_ns = SetClock().now_ns + 190_000_000
    return latch(HERE, now_ns=at_ns, token=token, status=(status,) * 3)


def on_a_board(*deliveries, text=ARM, **limits):
    """Flags while a board that reads the whole arm delivers something."""

    async def play(folder):
        limits.setdefault("refuse", ())
        quality = QualitySection(**limits)
        bench = Bench(arm_model(folder, text), quality=quality)
        bench.take(UP, *deliveries)
        bench.device.driver.close()
        return bench

    return play


def on_two_devices(*steps, speed=0.0, **assembly):
    """Devices that are read apart; the press is on a third."""

    async def play(folder):
        bench = ArmBench(folder, **assembly)
        bench.up()
        bench.stream(0, 30, speed)
        for step in steps:
            step(bench)
        bench.close()
        return bench

    return play


def press_handle(bench):
    bench.take(edge("handle", BEGIN_NS + 253_000_000))


def silence_wrist(seconds):
    """The wrist's readings stop, those of the base go on."""

    def step(bench):
        numbers = range(30, 30 + round(100 * seconds))
        bench.take(base().samples(numbers))
        bench.later(seconds + 1.0)

    return step


async def set_host_clock(folder):
    """UTC is set by a second while the arm is measured with."""
    bench = Bench(arm_model(folder), frozen=True)
    bench.take(UP, at_rest())
    bench.clock.offset_ns += 10**9
    bench.take(press())
    bench.device.driver.close()
    return bench


def entry(kind, **keys):
    return ARM + "\n" + effect(kind, **keys)


async def begin_in_1970(folder):
    """The computer has no battery for its clock."""
    bench = Bench(arm_model(folder), frozen=True)
    bench.clock.offset_ns = 0
    bench.take(UP, at_rest(), press())
    bench.device.driver.close()
    return bench


async def measure_unidentified(folder):
    """The arm file is not that of an identification."""
    model = read_model(arm_file(folder), {"base": None})
    bench = Bench(model)
    bench.take(UP, at_rest(), press())
    bench.device.driver.close()
    return bench


EXCHANGED = replace(UP, identity=replace(BOARD, serials=("BBB222",)))
CAUSES = {
    "encoder_error": on_a_board(at_rest(), press(STATUS_ERROR)),
    "encoder_warning": on_a_board(
        DeviceAlarm("base", 1, True, "weak", "weak signal", 0), at_rest(), press()
    ),
    "late": on_two_devices(silence_wrist(0.02)),
    "stale": on_a_board(at_rest(status=STATUS_STALE)),
    "incomplete": on_two_devices(silence_wrist(0.5)),
    "overspeed": on_a_board(turning(2000), overspeed_mm_s=1.0),
    "end_stop": on_a_board(
        at_rest(),
        end_stops=(EndStopSection(joint="J1", low_rad=0.0, high_rad=0.1),),
    ),
    "singular": on_a_board(at_rest(), singular_ratio=0.999),
    "temperature": on_a_board(
        DeviceTemperatures("base", (35.0,)), at_rest(), temperature_high_c=30.0
    ),
    "stale_identification": on_a_board(at_rest(), identification_days=1.0),
    "stale_effect": on_a_board(
        at_rest(),
        text=entry("encoder_drift", joint='"J2"', rate_rad_s=1e-3, epoch_utc=FIRST_UTC)
        + '[identification]\ndate = "2023-11-14T22:30:00.05Z"\n',
    ),
    "surface_unknown": on_a_board(
        at_rest(), press(), text=entry("probe_radius", radius_error_mm=0.1)
    ),
    "time_uncertain": set_host_clock,
    "turns_uncertain": on_a_board(POWER_LOST, at_rest(), press()),
    "interpolated": on_two_devices(press_handle),
    "empirical": on_a_board(
        at_rest(), text=entry("empirical", covariate='"J2_rad"', **CURVE)
    ),
    "beyond_knots": on_a_board(
        at_rest(),
        text=entry(
            "empirical", covariate='"J2_rad"', **CURVE | {"knots": [50.0, 51.0]}
        ),
    ),
    "temperature_unknown": on_a_board(
        at_rest(), text=entry("encoder_temperature", joint='"J2"', rate_rad_c=1e-4)
    ),
    "motion_unknown": on_a_board(
        at_rest(), text=entry("backlash", joint='"J2"', half_width_rad=1e-4)
    ),
    "geometry_unknown": measure_unidentified,
    "identity_unconfirmed": on_a_board(EXCHANGED, at_rest(), press()),
    "utc_uncertain": begin_in_1970,
    "skew": on_two_devices(press_handle, speed=3.0, skew_limit_mm=1e-9),
}


def test_each_documented_flag_has_a_cause():
    assert set(CAUSES) == {str(flag.name).lower() for flag in FLAG_MEANINGS}
    assert set(FLAG_MEANINGS) == set(QualityFlag)


@pytest.mark.parametrize("flag", list(FLAG_MEANINGS))
async def test_the_cause_sets_the_flag_and_nothing_else_does(flag, tmp_path):
    name = str(flag.name).lower()
    bench = await CAUSES[name](tmp_path)
    seen = {f for m in (*bench.live, *bench.points) for f in m.quality.flags}
    assert name in seen
    calm = await on_a_board(at_rest(), press())(tmp_path)
    assert not {f for m in (*calm.live, *calm.points) for f in m.quality.flags}


@pytest.mark.parametrize("step_s", [3.5, -3.5])
async def test_a_step_of_the_host_clock_is_reported_and_flagged(step_s, tmp_path):
    bench = Bench(arm_model(tmp_path), frozen=True)
    bench.take(UP, at_rest(), press())
    bench.clock.offset_ns += 9_000_000  # adjusted gradually
    bench.clock.now_ns += 1_000_000_000
    bench.measurement.process_timeouts()
    bench.clock.offset_ns += int(step_s * 1e9)
    bench.take(press(token=1))
    bench.clock.now_ns += 999_000_000
    bench.take(press(token=2))
    bench.clock.now_ns += 2_000_000
    bench.take(press(token=3))  # an edge of before the step, that comes late
    bench.take(latch(HERE, now_ns=bench.clock.now_ns, token=4))
    bench.device.driver.close()
    uncertain = ("time_uncertain",)
    flags = [point.quality.flags for point in bench.points]
    assert flags == [(), uncertain, uncertain, uncertain, ()]
    first, second, *_ = (point.time_ns for point in bench.points)
    assert second - first == 9_000_000 + int(step_s * 1e9)
    (event,) = [e for e in bench.events if e.code == "clock.stepped"]
    assert ("forward" if step_s > 0 else "back") in event.text
    assert "3.500 s" in event.text
    assert event.data == {"step_s": pytest.approx(step_s)}
