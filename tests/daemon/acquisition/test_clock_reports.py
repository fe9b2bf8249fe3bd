import pytest

from tests.daemon.board_harness import Bench
from tests.daemon.values import SetClock, arm_model
from traverse.daemon.acquisition.monitors import clock_text
from traverse.drivers.base.values import DeviceClockState
from traverse.drivers.timing.clock_report import LASTING_NS, LEAST_NS, ClockReporter
from traverse.drivers.timing.device_clock import DeviceClock


@pytest.mark.parametrize(
    ("rate", "said"), [(3e-3, "3000 ppm (0.300 %) fast"), (-1.5e-3, "0.150 %) slow")]
)
def test_rate_and_bound_are_stated(rate, said):
    text = clock_text("arm", DeviceClockState("arm", True, rate, 410_000))
    assert said in text
    assert "within 0.41 ms" in text
    doubt = clock_text("arm", DeviceClockState("arm", False, rate, 10**9))
    assert said in doubt
    assert "stood still or jumped" in doubt


def read(clock, first, n, ppm=0.0, lost_s=0.0):
    for k in range(first, first + n):
        ticks = int((k * 0.01 - lost_s) * 1e6 * (1.0 + ppm * 1e-6))
        clock.update(ticks, 10**12 + k * 10_000_000 + 100_000)


def test_a_clock_is_reported_when_it_is_learned_and_when_it_has_changed():
    said, clock, now = [], DeviceClock(1e6), SetClock()
    reporter = ClockReporter("arm", lambda state: said.append(state) or True)
    read(clock, 0, 1, ppm=3000.0)
    reporter.report(clock, now.now_ns)
    read(clock, 1, 300, ppm=3000.0)
    now.now_ns += LEAST_NS
    for _ in range(3):
        reporter.report(clock, now.now_ns)
    assert [state.is_certain for state in said] == [False, True]
    assert said[1].rate_error == pytest.approx(3e-3, rel=0.01)
    # It has lost 0.3 s; said once that lasts.
    read(clock, 301, 30, ppm=3000.0, lost_s=0.3)
    now.now_ns += 1
    reporter.report(clock, now.now_ns)
    assert len(said) == 2
    now.now_ns += LASTING_NS
    reporter.report(clock, now.now_ns)
    assert not said[-1].is_certain
    read(clock, 331, 300, ppm=3000.0, lost_s=0.3)
    reporter.report(clock, now.now_ns)
    assert said[-1].is_certain
    assert said[-1].steps == 1


async def test_a_rate_that_is_off_is_one_event_however_the_bound_varies(tmp_path):
    """A busy machine reads late, which leaves more open for a while."""
    bench = Bench(arm_model(tmp_path))
    for bound_ns in (400_000, 8_000_000, 500_000, 9_000_000):
        bench.take(DeviceClockState("base", True, 3e-3, bound_ns))
    assert bench.codes() == ["device.clock_rate"]
    bench.take(DeviceClockState("base", True, 1e-4, 300_000))
    bench.device.driver.close()
    assert [event.active for event in bench.events] == [True, False]
