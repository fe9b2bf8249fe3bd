"""Values beyond a limit are flagged, reported, and refused where configured."""

from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.effect_entries import effect
from tests.daemon.values import ARM as ARM_FILE
from tests.daemon.values import PoseMaker, SetClock, arm_model
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.conditions.table import ARM
from traverse.daemon.config.schema import EndStopSection, QualitySection
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.quality_monitor import QualityMonitor
from traverse.kinematics.arm_file.arm import Identification
from traverse.protocol.messages import QualityFlag

STOP = EndStopSection(joint="J1", low_rad=-1.0, high_rad=1.0, margin_rad=0.0)
DAY_NS = 86_400 * 10**9


class Bench:
    def __init__(self, model, **keys) -> None:
        self.clock, self.events, self.model = SetClock(), [], model
        section, events = (
            QualitySection(**keys),
            EventLog(self.clock, self.events.append),
        )
        conditions = ConditionMonitor(self.clock, events)
        limits = ("temperature_band", "identification_age")
        conditions.use(dict.fromkeys(limits, (ARM,)), ())
        self.watch = QualityMonitor(section, model, self.clock, events, conditions)
        self.poses = PoseMaker(model, 1_000_000)

    def block(self, first_rad=0.0, temperature_c=None):
        block = self.poses.block(range(4))
        block.angles_rad[:, 0] = first_rad
        self.watch.flag_block(self.model, block, temperature_c)
        return block.quality.tolist()

    def codes(self):
        return [(event.code, event.active) for event in self.events]


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return arm_model(tmp_path_factory.mktemp("arm"))


def test_without_limits_nothing_is_marked(model):
    assert Bench(model).block(9.0, 99.0) == [0, 0, 0, 0]


def test_a_passed_limit_is_reported_when_it_is_passed(model):
    bench = Bench(model, end_stops=(STOP,))
    assert bench.block(0.5) == [0] * 4
    assert bench.block(1.5) == [QualityFlag.END_STOP] * 4
    bench.block(1.5)
    bench.block(0.5)
    assert bench.codes() == [("limit.end_stop", None)]
    assert bench.events[0].text.startswith("J1: ")
    assert bench.events[0].remedy


def test_a_temperature_out_of_its_band_lasts_until_it_is_back(model):
    bench = Bench(model, temperature_low_c=18.0, temperature_high_c=22.0)
    flags = [bench.block(0.0, celsius)[0] for celsius in (20.0, 22.5, 21.0, None)]
    marked = QualityFlag.TEMPERATURE
    assert flags == [0, marked, 0, marked]  # it is unknown whether it is in the band
    assert bench.codes() == [
        ("limit.temperature", True),
        ("limit.temperature", False),
        ("limit.temperature", True),
    ]


def test_without_limits_the_temperatures_of_the_identification_count(model):
    known_c = {"temperature_low_c": 19.5, "temperature_high_c": 21.0}
    arm = model.arm.model_copy(update={"identification": Identification(**known_c)})
    seen_c = (21.0, 23.9, 24.1, None, 16.4, 16.6)
    bench = Bench(replace(model, arm=arm), temperature_change_c=None)
    flags = [bench.block(0.0, celsius)[0] for celsius in seen_c]
    marked = QualityFlag.TEMPERATURE
    assert flags == [0, 0, marked, 0, marked, 0]
    lost = [event.text for event in bench.events if event.active]
    assert "24.1 °C, its limits 16.5 °C and 24.0 °C" in lost[0]
    wide = Bench(replace(model, arm=arm), temperature_high_c=40.0)
    assert wide.block(0.0, 39.0) == [0] * 4


def test_an_arm_that_corrects_for_its_temperature_has_wider_limits(tmp_path):
    warm = arm_model(
        tmp_path, ARM_FILE + effect("thermal_expansion", expansion_per_c=2e-5)
    )
    known = Identification(temperature_low_c=19.5, temperature_high_c=21.0)
    arm = warm.arm.model_copy(update={"identification": known})
    # 59 degrees Fahrenheit of a cold room are no 59 °C.
    seen_c = (21.0, 35.9, 59.0, 4.6, 4.4)
    bench = Bench(replace(warm, arm=arm), temperature_change_c=None)
    flags = [bench.block(0.0, celsius)[0] for celsius in seen_c]
    marked = QualityFlag.TEMPERATURE
    assert [flag & marked for flag in flags] == [0, 0, marked, 0, marked]
    lost = [event.text for event in bench.events if event.code == "limit.temperature"]
    assert "59.0 °C, its limits 4.5 °C and 36.0 °C: 15 °C beyond" in lost[0]


def test_three_degrees_within_five_minutes_are_too_many(model):
    bench = Bench(model)
    flags = []
    for celsius, minutes in ((20.0, 4), (22.0, 4), (24.0, 2), (23.5, 4), (23.5, 10)):
        flags.append(bench.block(0.0, celsius)[0])
        bench.clock.now_ns += minutes * 60 * 10**9
    marked = QualityFlag.TEMPERATURE
    # 4 K in 8 minutes, but 20 held until 22 came, 4 minutes before 24.
    assert flags == [0, 0, marked, 0, 0]


def test_a_slow_change_is_none(model):
    bench = Bench(model)
    for tenth in range(100):  # 10 K in 50 minutes
        assert bench.block(0.0, 20.0 + 0.1 * tenth) == [0] * 4
        bench.clock.now_ns += 30 * 10**9


def test_an_old_identification_is_marked(model):
    now_s = (SetClock().now_ns + SetClock().utc_offset_ns()) * 1e-9
    stale = QualityFlag.STALE_IDENTIFICATION
    for identified_s, expected in (
        (None, stale),  # its age is unknown
        (now_s - 29 * 86_400, 0),
        (now_s - 31 * 86_400, stale),
    ):
        bench = Bench(
            replace(model, identified_s=identified_s), identification_days=30.0
        )
        assert bench.block() == [expected] * 4
    bench = Bench(replace(model, identified_s=now_s), identification_days=30.0)
    assert bench.block() == [0] * 4
    bench.clock.now_ns += 31 * DAY_NS
    assert bench.block() == [stale] * 4


def test_an_alarm_of_a_joints_encoder_marks_until_it_ends(model):
    bench = Bench(model)
    alarms = bench.watch.persistent
    alarms.alarm("base", 7, "encoder_alarm", True)  # no joint is there
    alarms.alarm("base", None, 5, True)  # of the board
    assert bench.block() == [0] * 4
    alarms.alarm("base", 1, "encoder_alarm", True)
    assert bench.block() == [QualityFlag.ENCODER_WARNING] * 4
    alarms.alarm("base", 1, "encoder_alarm", False)
    assert bench.block() == [0] * 4
    alarms.alarm("base", 1, "encoder_alarm", True)
    alarms.on_device_up("base")
    assert bench.block() == [0] * 4


def test_a_point_is_refused_by_the_flags_that_are_not_accepted(model):
    bench = Bench(model, refuse=("end_stop", "late"))
    bench.watch.check(int(QualityFlag.SINGULAR | QualityFlag.INTERPOLATED))
    with pytest.raises(CaptureRefusedError, match="flagged end_stop is") as caught:
        bench.watch.check(int(QualityFlag.END_STOP | QualityFlag.SINGULAR))
    assert "turn the joint back" in caught.value.remedy


def test_speed_is_marked_in_a_stream(model):
    bench = Bench(model, overspeed_mm_s=100.0)
    block = bench.poses.block(range(30))  # 1 mm along each axis a millisecond
    bench.watch.flag_block(model, block, None)
    unknown, fast = QualityFlag.MOTION_UNKNOWN, QualityFlag.OVERSPEED
    assert block.quality.tolist() == [unknown] * 5 + [fast] * 25
    assert np.unique(block.quality[5:]).tolist() == [fast]


def test_an_arm_that_is_only_moved_may_be_fast(model):
    bench = Bench(model, overspeed_mm_s=100.0)
    block = bench.poses.block(range(30))
    bench.watch.flag_block(model, block, None, is_scanning=False)
    assert block.quality[-1] == QualityFlag.OVERSPEED  # flagged all the same
    assert bench.codes() == []
    bench.watch.check(int(QualityFlag.OVERSPEED))  # a point is taken
    assert bench.codes() == [("limit.overspeed", None)]
    bench.clock.now_ns += 10**10
    bench.watch.flag_block(model, bench.poses.block(range(30, 60)), None)
    assert bench.codes() == [("limit.overspeed", None)] * 2
