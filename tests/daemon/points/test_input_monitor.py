"""Buttons that are closed at rest, stuck, or bounce."""

from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.arm_harness import IDENTITIES, ArmBench, edge
from tests.daemon.two_devices import BEGIN_NS, base, wrist
from traverse.daemon.config.schema import CaptureSection, InputSection
from traverse.daemon.points.input_monitor import ACTIVE, BOUNCED
from traverse.daemon.scans.plan import ScanPlan
from traverse.drivers.base.values import DeviceUp

MS = 1_000_000
EDGE_NS = BEGIN_NS + 400 * MS


async def bench_of(folder, **keys):
    """An arm whose pedal has these keys in its table."""
    pedal = InputSection(source="handle/0", trigger="button", **keys)
    bench = ArmBench(folder, capture={"inputs": (pedal,)})
    bench.up("base", "wrist")
    return bench


def pedal_up(bench, *, is_active):
    bench.take(DeviceUp("handle", IDENTITIES["handle"], False, int(is_active)))


def wait(bench, seconds):
    bench.later(seconds)
    bench.measurement.check_recent()


def measure(bench):
    bench.take(wrist().samples(range(80)), base().samples(range(100)))


def events(bench, code):
    return [event for event in bench.events if event.code == code]


async def test_a_pedal_that_is_pressed_since_the_start_is_reported_with_the_key(
    tmp_path,
):
    bench = await bench_of(tmp_path)
    pedal_up(bench, is_active=True)
    wait(bench, 1.5)
    assert events(bench, ACTIVE) == []
    wait(bench, 1.0)
    (event,) = events(bench, ACTIVE)
    assert (event.active, event.source, event.severity) == (True, "handle/0", "warning")
    assert "pressed since handle is there" in event.text
    assert "normally_closed = true" in event.remedy
    # A press of such a button opens it for moments, which proves nothing.
    bench.take(edge("handle", bench.clock.now_ns, active=False))
    wait(bench, 0.5)
    bench.take(edge("handle", bench.clock.now_ns))
    wait(bench, 5.0)
    assert len(events(bench, ACTIVE)) == 1
    bench.take(edge("handle", bench.clock.now_ns, active=False))
    wait(bench, 2.5)
    assert [event.active for event in events(bench, ACTIVE)] == [True, False]
    bench.close()


async def test_a_pedal_that_is_closed_at_rest_takes_points_when_it_opens(tmp_path):
    bench = await bench_of(tmp_path, normally_closed=True)
    assert [
        name
        for name, device in bench.devices.items()
        if device.delivery_queue.always_wakes
    ] == ["handle"]
    pedal_up(bench, is_active=True)
    measure(bench)
    bench.take(edge("handle", EDGE_NS, 1, active=False))
    bench.take(edge("handle", EDGE_NS + 100 * MS, 2, active=True))
    (point,) = bench.points
    assert point.time_ns == EDGE_NS + bench.clock.offset_ns
    assert bench.acknowledged("handle") == [1, 2]
    assert bench.codes().count("button.pressed") == 1
    wait(bench, 5.0)
    assert events(bench, ACTIVE) == []
    # The same key on one that is open at rest is noticed, too.
    pedal_up(bench, is_active=False)
    wait(bench, 2.5)
    (event,) = events(bench, ACTIVE)
    assert "take normally_closed out" in event.remedy
    bench.close()


@pytest.mark.parametrize("gap_ms", [2, 8, 59])
async def test_a_contact_that_bounces_is_one_press_and_is_reported(tmp_path, gap_ms):
    bench = await bench_of(tmp_path)
    pedal_up(bench, is_active=False)
    measure(bench)
    times_ms = (0, 5, 5 + gap_ms, 150, 150 + gap_ms, 155 + gap_ms)
    for token, at_ms in enumerate(times_ms):
        pressed = token % 2 == 0
        bench.take(edge("handle", EDGE_NS + at_ms * MS, token, active=pressed))
    assert [p.time_ns - bench.clock.offset_ns for p in bench.points] == [EDGE_NS]
    assert bench.acknowledged("handle") == list(range(len(times_ms)))
    event = events(bench, BOUNCED)[0]
    assert f"again {gap_ms} ms after it opened" in event.text
    assert "debounce_us of handle" in event.remedy
    bench.close()


async def test_two_presses_of_a_quick_hand_are_two(tmp_path):
    bench = await bench_of(tmp_path)
    pedal_up(bench, is_active=False)
    measure(bench)
    for token, at_ms in enumerate((0, 50, 115, 165)):
        bench.take(edge("handle", EDGE_NS + at_ms * MS, token, active=token % 2 == 0))
    # A clock that is not tied yet brings edges together that arrived one by one.
    late = edge("handle", EDGE_NS + 170 * MS, 4)
    bench.take(replace(late, received_ns=late.received_ns + 100 * MS))
    assert len(bench.points) == 3
    assert events(bench, BOUNCED) == []
    bench.close()


async def test_a_bounce_leaves_a_hold_a_hold_and_is_reported(tmp_path):
    bench = await bench_of(tmp_path, hold="undo")
    pedal_up(bench, is_active=False)
    measure(bench)
    for token, at_ms in enumerate((0, 5, 12)):
        bench.take(edge("handle", EDGE_NS + at_ms * MS, token, active=token % 2 == 0))
    wait(bench, 3.0)
    assert bench.codes().count("button.hold") == 1
    (event,) = events(bench, BOUNCED)
    assert "one more" in event.text
    bench.close()


@pytest.mark.parametrize(("keys", "n"), [({}, 1), ({"hold": "scan"}, 0)])
async def test_a_button_that_is_held_for_long_is_reported_unless_it_is_to_be_held(
    tmp_path, keys, n
):
    bench = await bench_of(tmp_path, **keys)
    pedal_up(bench, is_active=False)
    wait(bench, 3.0)
    bench.take(edge("handle", bench.clock.now_ns))
    wait(bench, 9.0)
    assert events(bench, ACTIVE) == []
    wait(bench, 2.0)
    assert len(events(bench, ACTIVE)) == n
    bench.close()


async def test_a_button_that_holds_a_scan_is_not_reported(tmp_path):
    bench = await bench_of(tmp_path)
    pedal_up(bench, is_active=False)
    wait(bench, 3.0)
    plan = ScanPlan("held", 100.0, 1, held=True)
    bench.scanner.start(plan, bench.measurement.model, bench.capture.session.id)
    bench.take(edge("handle", bench.clock.now_ns))
    wait(bench, 30.0)
    assert events(bench, ACTIVE) == []
    bench.close()


async def test_a_button_that_a_reload_adds_is_followed(tmp_path):
    bench = await bench_of(tmp_path)
    measurement = bench.measurement
    added = InputSection(source="base/1", trigger="button")
    capture = CaptureSection(inputs=(added,))
    changed = measurement.configuration.model_copy(update={"capture": capture})
    measurement.apply_settings(changed, measurement.model)
    for second in range(3):
        samples = base().samples(range(100 * second, 100 * second + 100))
        bench.take(replace(samples, inputs=np.full(100, 2, np.uint8)))
        bench.clock.now_ns = BEGIN_NS + (second + 1) * 1000 * MS
        measurement.check_recent()
    assert [event.source for event in events(bench, ACTIVE)] == ["base/1"]
    bench.close()


async def test_levels_of_a_stream_show_a_switch_that_touches_since_the_start(
    arm_bench,
):
    arm_bench.up()

    def stream(first, end, level):
        samples = base().samples(range(first, end))
        inputs = np.full(end - first, level, np.uint8)
        arm_bench.take(replace(samples, inputs=inputs))
        arm_bench.clock.now_ns = BEGIN_NS + end * 10 * MS
        arm_bench.measurement.check_recent()

    for second in range(3):
        stream(100 * second, 100 * second + 100, 1)
    (event,) = events(arm_bench, ACTIVE)
    assert (event.source, event.active) == ("base/0", True)
    assert "switch has been touching" in event.text
    for second in range(3, 6):
        stream(100 * second, 100 * second + 100, 0)
    assert [event.active for event in events(arm_bench, ACTIVE)] == [True, False]
    # A device that is away says nothing of its inputs.
    arm_bench.up("base")
    for second in range(6, 9):
        stream(100 * second, 100 * second + 100, 2)
    assert len(events(arm_bench, ACTIVE)) == 2
