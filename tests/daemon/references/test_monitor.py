"""Monitor of references: positions that are assumed are flagged until confirmed."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.board_harness import BOARD, Bench
from tests.daemon.two_devices import base
from tests.daemon.values import (
    ARM,
    MODULI,
    NOTHING_PUBLISHED,
    SetClock,
    arm_model,
    count_samples,
    latch,
)
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.conditions.table import BY_NAME
from traverse.daemon.config.schema import EndStopSection, QualitySection
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.executor import ConfirmReference
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.references.joint_turns import turn_dependent_joints
from traverse.daemon.references.memory import ConfirmedDevice, ReferenceMemory
from traverse.daemon.references.memory_file import ReferenceFile
from traverse.daemon.references.monitor import (
    ReferenceMonitor,
)
from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_MISSING,
    STATUS_STALE,
    DeviceUp,
)
from traverse.protocol.messages import QualityFlag, ReferenceArgs

SCALED = ARM + '\n[[effects]]\nkind = "encoder_scale"\njoint = "J2"\nscale_ppm = 40.0\n'
HARMONIC = (
    ARM + '\n[[effects]]\nkind = "encoder_harmonic"\njoint = "J2"\n'
    "order = 3\ncos_rad = 1e-4\nsin_rad = 2e-4\n"
)
CODE = BY_NAME["reference"].code


def up(*, restarted=False, boot="a", absolute=None, serials=("A1",)):
    identity = replace(BOARD, boot=boot, absolute=absolute, serials=serials)
    return DeviceUp("base", identity, restarted)


NAMELESS = up(boot="", serials=())


def rest(first):
    return count_samples(np.full((5, 3), 1000), first=first)


def press():
    return latch((1000, 1000, 1000), now_ns=SetClock().now_ns + 20_000_000)


class Rig:
    def __init__(self, folder, text=ARM, memory=None, **limits) -> None:
        self.events, clock = [], SetClock()
        self.limits = QualitySection(**limits)
        events = EventLog(clock, self.events.append)
        self.conditions = ConditionMonitor(clock, events)
        self.conditions.use({"reference": ("base",)}, ("base",))
        self.monitor = ReferenceMonitor(
            self.limits,
            arm_model(folder, text),
            clock,
            self.conditions,
            memory or ReferenceMemory(),
            NOTHING_PUBLISHED,
        )

    def accept(self, first):
        self.monitor.on_up(first)
        self.monitor.confirm()

    @property
    def is_doubtful(self):
        alarms = [event.active for event in self.events if event.code == CODE]
        assert bool(self.conditions.bits) == bool(alarms and alarms[-1])
        return bool(self.conditions.bits)


@pytest.mark.parametrize(
    ("of_device", "of_arm_file", "is_doubtful"),
    [
        (None, None, True),
        (False, None, True),
        (True, None, False),
        (None, "true", False),
        (True, "false", True),
    ],
)
def test_power_lost_while_measuring(tmp_path, of_device, of_arm_file, is_doubtful):
    text = ARM
    if of_arm_file:
        text = ARM.replace("sign =", f"absolute = {of_arm_file}\nsign =")
    rig = Rig(tmp_path, text)
    rig.monitor.on_up(up(absolute=of_device))
    assert rig.is_doubtful  # once, whatever it says of itself
    rig.monitor.confirm()
    rig.monitor.on_up(up(absolute=of_device, boot="b", restarted=True))
    assert rig.is_doubtful == is_doubtful
    rig.monitor.on_up(up(absolute=of_device, boot="b"))  # unplugged for a moment
    assert rig.is_doubtful == is_doubtful
    rig.monitor.confirm()
    assert not rig.is_doubtful


def test_power_lost_while_the_daemon_was_away(tmp_path):
    memory = ReferenceMemory()
    first = Rig(tmp_path, memory=memory)
    first.monitor.on_up(up(boot="a"))
    first.monitor.confirm()
    same = Rig(tmp_path, memory=memory)
    same.monitor.on_up(up(boot="a"))
    assert not same.is_doubtful
    other = Rig(tmp_path, memory=memory)
    other.monitor.on_up(up(boot="b"))
    assert other.is_doubtful
    # A daemon that starts again still requires the confirmation.
    again = Rig(tmp_path, memory=memory)
    again.monitor.on_up(up(boot="b"))
    assert again.is_doubtful
    assert again.monitor.confirm().keys() == {"base"}
    last = Rig(tmp_path, memory=memory)
    last.monitor.on_up(up(boot="b"))
    assert not last.is_doubtful


def test_an_incremental_device_is_in_doubt_until_it_is_confirmed(tmp_path):
    rig = Rig(tmp_path)
    rig.monitor.on_up(up(absolute=False, boot=""))
    assert rig.is_doubtful
    (event,) = rig.events
    assert event.severity == "error"
    assert "J1, J2, J3 may count from another place" in event.text
    assert "traverse confirm" in event.remedy
    assert rig.monitor.confirm().keys() == {"base"}
    assert not rig.is_doubtful


def test_turns_matter_where_the_pose_is_another_one_a_turn_later(tmp_path):
    clock, nothing = SetClock(), QualitySection()
    assert turn_dependent_joints(nothing, arm_model(tmp_path, ARM), clock) == ()
    assert turn_dependent_joints(nothing, arm_model(tmp_path, HARMONIC), clock) == ()
    scaled = arm_model(tmp_path, SCALED)
    assert turn_dependent_joints(nothing, scaled, clock) == (1,)


@pytest.mark.parametrize(
    ("low_rad", "high_rad", "is_doubtful"),
    [(-3.5, 2.5, False), (-0.5, 5.0, True), (-7.0, 7.0, True)],
)
def test_end_stops_exclude_other_turns(tmp_path, low_rad, high_rad, is_doubtful):
    """The joint's zero is at -0.5 rad, so its nearest turn is -3.64 to 2.64 rad."""
    stop = EndStopSection(joint="J2", low_rad=low_rad, high_rad=high_rad)
    memory = ReferenceMemory()
    Rig(tmp_path, SCALED, memory).accept(up(absolute=True))
    rig = Rig(tmp_path, SCALED, memory, end_stops=(stop,))
    rig.monitor.on_up(up(absolute=True))
    assert rig.is_doubtful == is_doubtful
    if is_doubtful:
        assert "the turn of J2 is assumed" in rig.events[0].text


def test_a_reload_with_an_effect_that_depends_on_turns_is_in_doubt(tmp_path):
    rig = Rig(tmp_path, HARMONIC)
    rig.accept(up(absolute=True))
    assert not rig.is_doubtful
    scaled = arm_model(tmp_path, SCALED)
    rig.monitor.use(rig.limits, scaled)
    assert rig.is_doubtful
    rig.monitor.confirm()
    rig.monitor.use(rig.limits, scaled)
    assert not rig.is_doubtful


OTHER_ARM = ARM.replace("[[joints]]", 'serial_number = "7"\n[[joints]]', 1)


@pytest.mark.parametrize("is_reloaded", [True, False])
def test_devices_are_confirmed_with_the_file_of_one_arm(tmp_path, is_reloaded):
    rig = Rig(tmp_path)
    rig.accept(up(absolute=True))
    memory = rig.monitor.devices.memory
    if is_reloaded:
        rig.monitor.use(rig.limits, arm_model(tmp_path, OTHER_ARM))
    else:
        rig = Rig(tmp_path, OTHER_ARM, memory)
        rig.monitor.on_up(up(absolute=True))
    assert rig.is_doubtful
    assert "serial number 7 now" in rig.events[-1].text
    rig.monitor.home({"J1": 0.0})  # which says nothing of the links
    assert rig.is_doubtful
    rig.monitor.confirm()
    assert not rig.is_doubtful
    again = Rig(tmp_path, OTHER_ARM, memory)
    again.monitor.on_up(up(absolute=True))
    assert not again.is_doubtful


def test_what_was_confirmed_before_arms_were_kept_stays_confirmed(tmp_path):
    rig = Rig(tmp_path)
    rig.accept(up(absolute=True))
    values = rig.monitor.devices.memory.devices["base"].to_values()
    del values["arm"]
    memory = ReferenceMemory({"base": ConfirmedDevice.from_values(values)})
    later = Rig(tmp_path, memory=memory)
    later.monitor.on_up(up(absolute=True))
    assert not later.is_doubtful


def test_what_is_confirmed_outlives_the_daemon(tmp_path):
    path = tmp_path / "references.json"
    memory = ReferenceFile(path)
    assert memory.devices == {}
    base = ConfirmedDevice("J1: channel 0", ("AAA111", ""), "b", "1.2.3", {"J1": -1.25})
    memory.add({"base": ConfirmedDevice("J1: channel 0", boot="a")})
    memory.add({"base": base, "wrist": ConfirmedDevice("J2: channel 1")})
    memory.writing.result(timeout=10.0)  # durable before it is answered
    stored = json.loads(path.read_text())
    assert stored["schema"] == "traverse/references/1"
    assert stored["devices"]["base"]["serials"] == ["AAA111", ""]
    memory.close()
    read = ReferenceFile(path)
    assert read.devices == memory.devices
    assert read.devices["base"].offsets_rad == {"J1": -1.25}


@pytest.mark.parametrize(
    "content",
    [
        b"\xff",
        b"[]",
        b'{"base": ',
        b"[" * 3000,
        b'{"schema": "traverse/references/2", "devices": {}}',
    ],
)
def test_a_damaged_file_puts_everything_in_doubt(tmp_path, content):
    path = tmp_path / "references.json"
    path.write_bytes(content)
    rig = Rig(tmp_path, memory=ReferenceFile(path))
    rig.monitor.on_up(up())
    assert rig.is_doubtful


def test_a_full_disk_does_not_stop_measuring(tmp_path, caplog):
    memory = ReferenceFile(tmp_path / "missing" / "references.json")
    memory.add({"base": ConfirmedDevice("")})
    memory.close()
    assert "have to be confirmed again" in caplog.text


async def test_points_and_poses_are_flagged_until_confirmed(bench):
    bench.take(up(boot="1", serials=()), rest(0))
    bench.take(up(boot="b", restarted=True, serials=()), rest(5))
    bench.take(press())
    assert bench.points[-1].quality.flags == ("turns_uncertain",)
    assert not bench.points[-1].quality.ok
    args = ReferenceArgs(action="confirm")
    assert "base" in await ConfirmReference(args).execute(bench.measurement)
    bench.take(rest(10), press())
    assert bench.points[-1].quality.ok
    assert [e.active for e in bench.events if e.code == CODE] == [True, False]


def turning(speed_rad_s, times_ns, *, from_rad=0.25, status=0):
    """Samples of an arm that turns; counts of channel 0 go over 4096 turns."""
    turns = np.array([1 << 20, 1 << 23, 1 << 16])
    elapsed_s = (np.array(times_ns) - SetClock().now_ns)[:, np.newaxis] * 1e-9
    angles_rad = np.array([1.0, from_rad, 1.234]) + speed_rad_s * elapsed_s
    counts = np.rint(angles_rad * turns / (2 * np.pi)).astype(np.int64) % MODULI
    samples = count_samples(counts, first=round(elapsed_s[0, 0] * 100))
    return replace(samples, status=np.full(counts.shape, status, np.uint8))


def blind(bench, speeds_rad_s, status, seconds=0.8, **more):
    begin = bench.clock.now_ns
    speeds_rad_s = np.array(speeds_rad_s)
    for first in range(0, 200, 4):
        times_ns = begin + 10_000_000 * np.arange(first, first + 4)
        is_out = 40 <= first < 40 + round(100 * seconds)
        bench.clock.now_ns = int(times_ns[-1])
        if status or not is_out:
            missing = status if is_out else 0
            bench.take(turning(speeds_rad_s, times_ns, status=missing, **more))


SCALED_J3 = SCALED.replace('joint = "J2"', 'joint = "J3"')
STOPS = EndStopSection(joint="J3", low_rad=-2.8, high_rad=3.3)


@pytest.mark.parametrize("status", [0, STATUS_ERROR, STATUS_MISSING, STATUS_STALE])
@pytest.mark.parametrize(
    ("text", "speeds_rad_s", "seconds", "stops", "named"),
    [
        # J2, J3, J1; only J3's encoder does not count its turns.
        (ARM, (0.0, 6.0, 0.0), 0.8, (), "J3 was not read for 0.81 s"),
        (ARM, (0.0, 6.0, 0.0), 0.12, (), None),
        (ARM, (0.0, 6.0, 6.0), 0.8, (), "J3 was not read"),
        (ARM, (0.0, 0.0, 0.0), 0.8, (), None),
        (ARM, (6.0, 0.0, 0.0), 0.8, (), None),
        (SCALED, (6.0, 0.0, 0.0), 0.8, (), None),
        (SCALED_J3, (0.0, 0.0, 0.0), 0.8, (), "J3 was not read"),
        (SCALED_J3, (0.0, -2.0, 0.0), 0.8, (STOPS,), None),
    ],
)
async def test_a_turn_that_may_be_lost_while_not_read(
    tmp_path, text, *, speeds_rad_s, seconds, stops, named, status
):
    bench = Bench(arm_model(tmp_path, text), quality=QualitySection(end_stops=stops))
    try:
        bench.take(up(absolute=True))
        bench.measurement.references.confirm()
        blind(bench, speeds_rad_s, status, seconds, from_rad=2.6 if stops else 0.25)
        alarms = [e for e in bench.events if e.code == CODE and "not read" in e.text]
        assert len(alarms) == (named is not None)
        bench.take(replace(press(), sample_time_ns=bench.clock.now_ns))
        flags = bench.points[-1].quality.flags
        assert ("turns_uncertain" in flags) == (named is not None)
        if named is not None:
            assert named in alarms[0].text
            assert bench.measurement.references.confirm().keys() == {"base"}
    finally:
        bench.device.driver.close()


@pytest.mark.parametrize("status", [0, STATUS_ERROR])
async def test_turns_that_are_known_are_right_after_an_outage(tmp_path, status):
    """J2 counts its turns, and makes three; J3's end stops leave only one."""
    bench = Bench(arm_model(tmp_path), quality=QualitySection(end_stops=(STOPS,)))
    try:
        bench.take(up(absolute=True))
        blind(bench, (25.0, -3.0, 0.0), status, from_rad=3.0)
        bench.measurement.process_timeouts()
        angles_rad = bench.measurement.trajectory._blocks[-1].angles_rad[-1]
        elapsed_s = 1.99
        assert angles_rad[2] == pytest.approx(3.0 - 3.0 * elapsed_s, abs=1e-4)
        # Its sign is -1, and its first turn the one nearest to zero_rad.
        assert angles_rad[1] == pytest.approx(-1.0 - 25.0 * elapsed_s, abs=1e-4)
    finally:
        bench.device.driver.close()


@pytest.mark.parametrize("speed", [0.0, 4.0])
async def test_a_joint_on_a_line_that_was_silent(arm_bench, speed):
    """J3's readings are interpolated; they are missing for 0.8 s."""
    bench = arm_bench
    bench.measurement.references.confirm()
    bench.stream(0, 40, speed)
    for first in range(40, 120, 4):
        bench.take(base(speed=speed).samples(range(first, first + 4)))
        bench.later(0.04)
    bench.stream(120, 140, speed)
    bench.later(0.5)
    alarms = [e for e in bench.events if e.code == CODE and "not read" in e.text]
    assert [e.source for e in alarms] == (["wrist"] if speed else [])
    assert ("turns_uncertain" in bench.live[-1].quality.flags) == bool(speed)


async def test_a_known_point_is_held_against_the_position(bench):
    bench.take(up(), rest(0))
    bench.take(up(boot="b", restarted=True), rest(5))
    bench.clock.now_ns += 200_000_000
    here_mm = bench.measurement.trajectory.position_mm(bench.clock.now_ns)
    off = tuple((here_mm + np.array([0.0, 2.0, 0.0])).tolist())
    wrong = ReferenceArgs(action="confirm", at_xyz_mm=off)
    with pytest.raises(CaptureRefusedError, match=r"2\.000 mm from the known point"):
        await ConfirmReference(wrong).execute(bench.measurement)
    assert bench.measurement.conditions.bits
    right = ReferenceArgs(action="confirm", at_xyz_mm=off, tolerance_mm=2.1)
    await ConfirmReference(right).execute(bench.measurement)
    assert not bench.measurement.conditions.bits


# -- identity -------------------------------------------------------------------------


class Pair(Rig):
    """One device of two joints with serial numbers, over restarts of the daemon."""

    def __init__(self, folder, memory):
        super().__init__(folder, memory=memory)
        self.conditions.use(
            dict.fromkeys(("identity", "reference"), ("base",)), ("base",)
        )

    def texts(self, name):
        code = BY_NAME[name].code
        return [e.text for e in self.events if e.code == code and e.active]


NUMBERED = ("AAA111", "BBB222", "CCC333")
SWAPPED = ("BBB222", "AAA111", "CCC333")


@pytest.mark.parametrize("is_over_a_restart", [False, True])
def test_encoders_that_change_places_are_in_doubt(tmp_path, is_over_a_restart):
    memory = ReferenceMemory()
    pair = Pair(tmp_path, memory)
    first = up(absolute=True, serials=NUMBERED)
    pair.monitor.on_up(first)
    assert "AAA111, BBB222, CCC333, never confirmed" in pair.texts("identity")[0]
    pair.monitor.confirm()
    assert pair.conditions.bits == 0
    if is_over_a_restart:
        pair = Pair(tmp_path, memory)
    pair.monitor.on_up(up(absolute=True, serials=SWAPPED))
    assert pair.conditions.bits == (
        QualityFlag.IDENTITY_UNCONFIRMED | QualityFlag.TURNS_UNCERTAIN
    )
    text = pair.texts("identity")[-1]
    # J2 is on channel 0 of the arm file, J3 on channel 1.
    assert "J2 was AAA111, is BBB222; J3 was BBB222, is AAA111" in text
    accepted = pair.monitor.confirm()
    assert "J2 was AAA111, is BBB222" in accepted["base"]
    assert pair.conditions.bits == 0
    assert memory.devices["base"].serials == SWAPPED


def test_encoders_that_are_put_back_need_no_confirmation(tmp_path):
    pair = Pair(tmp_path, ReferenceMemory())
    pair.accept(up(absolute=True, serials=NUMBERED))
    pair.monitor.on_up(up(absolute=True, serials=SWAPPED))
    assert pair.conditions.bits
    pair.monitor.on_up(up(absolute=True, serials=NUMBERED))
    assert pair.conditions.bits == 0


def test_a_serial_number_that_is_not_reported_is_not_the_confirmed_one(tmp_path):
    pair = Pair(tmp_path, ReferenceMemory())
    pair.accept(up(absolute=True, serials=NUMBERED))
    pair.monitor.on_up(up(absolute=True, serials=("AAA111", "", "CCC333")))
    assert pair.texts("identity")[-1].endswith("J3 was BBB222, is unknown")


def test_a_device_that_cannot_tell_its_power_up_is_in_doubt_at_each_start(tmp_path):
    """A text line, whose arm file says nothing of absolute encoders."""
    memory = ReferenceMemory()
    for _ in range(2):
        rig = Rig(tmp_path, memory=memory)
        rig.accept(NAMELESS)
        assert not rig.is_doubtful
    again = Rig(tmp_path, memory=memory)
    again.monitor.on_up(NAMELESS)
    assert again.is_doubtful


UNRECOGNISED = [
    (),  # as of AMT21, Modbus and text lines
    ("",),
    ("AAA111", "", "CCC333"),
    ("1", "1", "1"),  # as of encoders that come with the same number
    ("7", "wrist"),  # another device has it, too
]


@pytest.mark.parametrize("serials", UNRECOGNISED)
@pytest.mark.parametrize("of_family", [True, None])
def test_what_may_have_been_exchanged_is_confirmed_at_each_start(
    tmp_path, serials, of_family
):
    absolute = ARM.replace("sign =", "absolute = true\nsign =")
    memory, device = ReferenceMemory(), up(boot="", absolute=of_family, serials=serials)
    wrist = BOARD if serials != ("7", "wrist") else replace(BOARD, serials=("wrist",))
    for _ in range(2):
        rig = Rig(tmp_path, absolute, memory)
        rig.monitor.devices.identities["wrist"] = wrist
        rig.monitor.on_up(device)
        assert rig.is_doubtful
        assert "confirm" in rig.events[-1].remedy
        rig.monitor.on_up(device)  # the line was cut for a moment
        assert rig.is_doubtful
        rig.monitor.confirm()
        assert not rig.is_doubtful
        # Once more: two boards that were switched on together count on alike.
        rig.monitor.on_up(device)
        assert rig.is_doubtful
    assert "assumed_devices" in rig.events[-1].remedy
    assumed = Rig(tmp_path, absolute, memory, assumed_devices=("base",))
    assumed.monitor.on_up(device)
    assert not assumed.is_doubtful
    assumed.monitor.on_up(replace(device, restarted=True))
    assert not assumed.is_doubtful


@pytest.mark.parametrize("is_restart_of_daemon", [True, False])
def test_another_resolution_of_the_same_encoder_is_in_doubt(
    tmp_path, is_restart_of_daemon
):
    """Set by a switch while it was off: half a turn is one, or two turns are one."""
    memory = ReferenceMemory()
    absolute = ARM.replace("sign =", "absolute = true\nsign =")
    rig = Rig(tmp_path, absolute, memory)
    rig.accept(up())
    moduli = tuple(2 * modulus for modulus in BOARD.moduli_counts)
    identity = replace(BOARD, boot="a", serials=("A1",), moduli_counts=moduli)
    if is_restart_of_daemon:
        rig = Rig(tmp_path, absolute, memory)
        rig.monitor.on_up(up())
        assert not rig.is_doubtful
    rig.monitor.on_up(DeviceUp("base", identity, restarted=False))
    assert rig.is_doubtful
    assert "otherwise than when confirmed" in rig.events[-1].text
    rig.monitor.confirm()
    assert not rig.is_doubtful


def test_an_assumed_device_still_loses_its_power(tmp_path):
    memory = ReferenceMemory()
    Rig(tmp_path, memory=memory).accept(NAMELESS)
    rig = Rig(tmp_path, memory=memory, assumed_devices=("base",))
    rig.monitor.on_up(NAMELESS)
    assert rig.is_doubtful
    assert "assumed_devices" not in rig.events[-1].remedy


def test_an_absolute_family_that_the_arm_file_calls_incremental(tmp_path):
    """Its driver does not look for a loss of power, so each new contact may be one."""
    incremental = ARM.replace("sign =", "absolute = false\nsign =")
    rig = Rig(tmp_path, incremental)
    rig.accept(up(boot="", absolute=True))
    rig.monitor.on_up(up(boot="", absolute=True))
    assert rig.is_doubtful


def test_another_arm_file_needs_another_confirmation(tmp_path):
    memory = ReferenceMemory()
    Rig(tmp_path, memory=memory).accept(up(absolute=True))
    other = Rig(tmp_path, ARM.replace("sign = -1", "sign = 1", 1), memory)
    other.monitor.on_up(up(absolute=True))
    assert other.is_doubtful
    assert "otherwise than when confirmed" in other.events[0].text


@pytest.mark.parametrize("is_restart_of_daemon", [False, True])
def test_other_firmware_may_count_otherwise(tmp_path, is_restart_of_daemon):
    memory = ReferenceMemory()
    absolute = ARM.replace("sign =", "absolute = true\nsign =")
    rig = Rig(tmp_path, absolute, memory)
    identity = replace(BOARD, boot="a", serials=("A1",), firmware="1.2.3")
    rig.accept(DeviceUp("base", identity, restarted=False))
    if is_restart_of_daemon:
        rig = Rig(tmp_path, absolute, memory)
    rig.monitor.on_up(DeviceUp("base", replace(identity, boot="b"), restarted=True))
    assert not rig.is_doubtful

    updated = replace(identity, boot="c", firmware="1.3.0")
    rig.accept(DeviceUp("base", updated, restarted=True))
    texts = [event.text for event in rig.events if event.active]
    assert "firmware 1.2.3 when confirmed, 1.3.0 now" in texts[-1]
    rig.monitor.on_up(DeviceUp("base", replace(updated, boot="d"), restarted=True))
    assert not rig.is_doubtful


@pytest.mark.parametrize("boots", [("a", "b"), ("1", "1")])
def test_boards_that_nothing_tells_apart_may_have_changed_places(tmp_path, boots):
    """Cloned firmware: the same board_id, and perhaps one boot_id for all time."""
    text, memory = ARM.replace('"base/1"', '"wrist/0"'), ReferenceMemory()
    names = ("base", "wrist")
    ups = [
        DeviceUp(name, replace(BOARD, serials=("0",), boot=boot), restarted=False)
        for name, boot in zip(names, boots, strict=True)
    ]
    for is_again in (False, True):
        rig = Rig(tmp_path, text, memory)
        rig.conditions.use({"reference": names}, names)
        for device_up in ups:
            rig.monitor.on_up(device_up)
        assert rig.is_doubtful == (not is_again or boots == ("1", "1"))
        rig.monitor.confirm()
        assert not rig.is_doubtful


@pytest.mark.parametrize("is_over_a_restart", [False, True])
def test_a_device_whose_count_jumped_has_to_be_confirmed(tmp_path, is_over_a_restart):
    memory = ReferenceMemory()
    absolute = ARM.replace("sign =", "absolute = true\nsign =")
    rig = Rig(tmp_path, absolute, memory)
    rig.accept(up(absolute=True))
    counts = np.full((60, 3), 1000)
    rig.monitor.add(count_samples(counts[:30]))
    assert not rig.is_doubtful
    counts[30:, 0] += 3000  # 18 mrad
    rig.monitor.add(count_samples(counts[30:], first=30))
    assert rig.is_doubtful
    if is_over_a_restart:
        rig = Rig(tmp_path, absolute, memory)
    rig.monitor.on_up(up(absolute=True))
    assert rig.is_doubtful
    rig.monitor.confirm()
    assert not rig.is_doubtful
