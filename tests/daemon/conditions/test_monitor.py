"""Events of conditions that samples flag in turns."""

import pytest

from tests.daemon.values import SetClock
from traverse.daemon.conditions.monitor import CALM_NS, ConditionMonitor, meanings
from traverse.daemon.conditions.table import ARM
from traverse.daemon.monitoring.events import EventLog
from traverse.protocol.messages import QualityFlag

LATE, WARNING = QualityFlag.LATE.value, QualityFlag.ENCODER_WARNING.value


@pytest.fixture
def watched():
    """A monitor of `readings`, which hold, its clock and events."""
    clock, events = SetClock(), []
    monitor = ConditionMonitor(clock, EventLog(clock, events.append))
    monitor.use({"readings": (ARM,)}, ())
    monitor.establish("readings")
    return monitor, clock, events


def test_flags_that_come_in_turns_are_reported_once_each(watched):
    monitor, _, events = watched
    for _ in range(5):
        monitor.add_samples(LATE)
        monitor.add_samples(WARNING)
        monitor.add_samples(LATE | WARNING)
    assert [event.text for event in events if event.active] == [
        meanings(LATE),
        meanings(LATE | WARNING),
    ]


def test_what_was_before_it_held_is_not_reported_again(watched):
    monitor, clock, events = watched
    monitor.add_samples(LATE)
    clock.now_ns += CALM_NS
    monitor.add_samples(0)
    assert monitor.is_established("readings")
    monitor.add_samples(WARNING)
    assert events[-1].text == meanings(WARNING)


def test_a_device_that_is_named_as_the_arm_keeps_its_own_cause(watched):
    monitor, clock, events = watched
    monitor.use({"readings": (ARM,), "device_clock": (ARM,)}, (ARM,))
    monitor.establish("device_clock", ARM)
    for _ in range(50):
        monitor.mark("device_clock", ARM, "its timer has stood still")
        monitor.add_samples(QualityFlag.TIME_UNCERTAIN.value)
        clock.now_ns += 10_000_000
    assert [event.text for event in events] == ["its timer has stood still"]


def test_a_button_box_that_is_named_as_the_arm_marks_no_number(watched):
    monitor, _, _ = watched
    monitor.use({"readings": (ARM,), "present": ("base", ARM)}, ("base",))
    monitor.establish("present", "base")
    assert monitor.all_established
    assert not monitor.bits
