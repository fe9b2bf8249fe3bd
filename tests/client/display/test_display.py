"""State of an arm on the page, and its texts.

Deviation from a nominal place, and when it is proved.
Clouds of scanned points within a budget.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.client.display.values import (
    doubt,
    event,
    golden,
    health,
    live,
    point,
    retraction,
    status,
)
from tests.protocol.message_examples import CLOCK
from traverse.arrays import Integers
from traverse.client.display.arm_state import MAX_POINTS, ArmSight, Change
from traverse.client.display.condition import obstacle, verdict, wanted_commands
from traverse.client.display.figures import (
    INCH,
    MM,
    expanded_axes_mm,
    place_uncertainty,
)
from traverse.client.display.inspection_desk import InspectionDesk
from traverse.client.display.nominal import Nominal
from traverse.client.display.point_cloud import Cloud
from traverse.client.page.health_tables import condition_list, health_table
from traverse.client.page.readout import point_rows
from traverse.protocol.messages import Alarm, Quality, Scan

FINE = {"ok": True, "flags": []}
SAME = {"text": "was AAA111, is BBB222", "remedy": "look"}


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def sight(clock: Clock) -> ArmSight:
    sight = ArmSight(clock)
    sight.take_link(True, "")
    sight.take_status(status())
    sight.take_live(live(quality={"ok": True, "flags": []}))
    return sight


def changes(sight: ArmSight) -> list[Change]:
    reported: list[Change] = []
    sight.listeners.append(reported.append)
    return reported


def test_points_stand_until_they_are_taken_back(sight: ArmSight) -> None:
    seen = changes(sight)
    for seq in range(3):
        sight.take_point(point(seq))
    sight.take_point(retraction(3, of=2))
    assert list(sight.points) == ["p-0", "p-1"]
    assert sight.last_point is not None
    assert sight.last_point.seq == 1
    assert [change.kind for change in seen] == ["point"] * 3 + ["retraction"]


def test_a_point_in_doubt_is_reported_with_the_reason(sight: ArmSight) -> None:
    seen = changes(sight)
    sight.take_point(point(0, quality={"ok": False, "flags": ["end_stop"]}))
    assert seen[0].text == "Point 0, in doubt: end stop"


def test_the_list_is_bounded(sight: ArmSight) -> None:
    first = point(0)
    for seq in range(MAX_POINTS + 10):
        sight.take_point(first.model_copy(update={"id": f"p-{seq}"}))
    assert len(sight.points) == MAX_POINTS
    assert next(iter(sight.points)) == "p-10"


def test_a_new_session_begins_an_empty_list(sight: ArmSight) -> None:
    sight.take_point(point(0))
    sight.take_status(status(session="another"))
    assert not sight.points


def test_coverage_counts_sectors_of_ten_degrees(sight: ArmSight) -> None:
    sight.coverage = None
    n = len(live().angles_rad)
    for degrees in (5.0, 6.0, 359.0, -1.0, 725.0):
        sight.take_live(live(angles_rad=[np.radians(degrees)] * n))
    assert sight.coverage is not None
    expected = np.zeros(36, dtype=np.int64)
    expected[0], expected[35] = 3, 2
    assert (sight.coverage == expected).all()


def test_a_well_arm_is_ready(sight: ArmSight) -> None:
    assert verdict(sight).level == "good"


def test_without_the_broker_everything_is_stale_and_says_so(sight: ArmSight) -> None:
    seen = changes(sight)
    sight.take_link(False, "it was there and is gone")
    assert sight.is_stale
    shown = verdict(sight)
    assert shown.level == "bad"
    assert "No connection to the broker" in shown.sentence
    assert "the arm keeps its points" in shown.remedy
    assert [change.kind for change in seen] == ["link"]


def test_poses_that_stop_make_it_stale(sight: ArmSight, clock: Clock) -> None:
    assert not sight.is_stale
    clock.now_s += 7.0
    assert sight.is_stale
    assert verdict(sight).sentence == "No pose for 7 s."


def test_an_alarm_is_shown_until_it_is_cleared(sight: ArmSight) -> None:
    seen = changes(sight)
    raised = event(
        "device.lost",
        True,
        severity="error",
        source="base",
        text="it is gone",
        remedy="plug it in",
    )
    sight.take_event(raised)
    shown = verdict(sight)
    assert (shown.level, shown.sentence, shown.remedy) == (
        "bad",
        "base: it is gone",
        "plug it in",
    )
    sight.take_event(
        event("device.lost", False, severity="error", source="base", text="back")
    )
    assert verdict(sight).level == "good"
    assert [change.kind for change in seen] == ["alarm", "cleared"]


def test_a_point_that_an_event_puts_in_doubt_is_flagged_afterwards(sight: ArmSight):
    sight.take_point(point(1, quality=FINE))
    sight.take_point(point(2, quality=FINE))
    first = sight.points["p-1"]
    desk, seen = InspectionDesk(sight), changes(sight)
    desk.begin("plane")
    sight.take_point(point(3, quality=FINE))
    for _ in range(2):  # a new connection tells all of them again
        sight.take_doubt(doubt(points="p-2 p-3 p-99"))
    assert sight.points["p-1"] == first
    for name in ("p-2", "p-3"):
        assert sight.points[name].quality == Quality(ok=False, flags=("stale",))
    kinds = [change.kind for change in seen]
    assert kinds == ["point", "doubt", "doubt"]
    assert desk._points == {"p-3": sight.points["p-3"]}


def test_the_worst_of_several_is_first_and_the_others_are_counted(
    sight: ArmSight,
) -> None:
    sight.take_event(event("a.mild", True, severity="warning", text="mild"))
    sight.take_event(event("a.grave", True, severity="error", text="grave"))
    shown = verdict(sight)
    assert (shown.level, shown.n_others) == ("bad", 1)
    assert shown.sentence.endswith(": grave")


def test_an_arm_that_went_off_line_is_bad_and_forgets_its_alarms(
    sight: ArmSight,
) -> None:
    sight.take_event(event("a.grave", True, severity="error", text="grave"))
    sight.take_status(status(online=False, state="offline"))
    assert verdict(sight).sentence == "The arm is off line."
    assert not sight.alarms


def test_a_device_that_is_missing_is_named(sight: ArmSight) -> None:
    lost_device = {
        "id": "wrist",
        "driver": "x",
        "port": "y",
        "state": "lost",
        "identity": {},
    }
    sight.take_status(status(state="degraded", drivers=[lost_device]))
    assert verdict(sight).sentence == "Not all devices are there: wrist."


def test_a_disk_that_keeps_no_points_is_bad(sight: ArmSight) -> None:
    outbox = health().outbox.model_dump(mode="json") | {"state": "failed"}
    sight.take_health(health(outbox=outbox))
    assert verdict(sight).level == "bad"


def test_a_pose_in_doubt_is_a_warning(sight: ArmSight) -> None:
    sight.take_live(live(quality={"ok": False, "flags": ["singular"]}))
    shown = verdict(sight)
    assert shown.level == "warning"
    assert "singular" in shown.sentence


def test_a_refusal_is_reported(sight: ArmSight) -> None:
    seen = changes(sight)
    sight.take_event(event("capture.refused", None, text="the arm moves"))
    assert seen == [Change("refused", "The arm moves. Check the cable")]


@pytest.mark.parametrize("event_first", [True, False])
def test_answer_and_event_of_one_refusal_are_reported_once(
    sight: ArmSight, clock: Clock, event_first: bool
) -> None:
    seen = changes(sight)
    refused = event("capture.refused", None, text="the arm moves", remedy="wait")
    reports = [
        lambda: sight.take_event(refused),
        lambda: sight.refuse("the arm moves", "wait"),
    ]
    for tell in reports if event_first else reversed(reports):
        tell()
    assert [change.text for change in seen] == ["The arm moves. Wait"]
    clock.now_s += 1.0
    sight.refuse("the arm moves", "wait")  # another press
    assert len(seen) == 2


def test_points_of_before_come_late_and_silently(sight: ArmSight) -> None:
    assert sight.live is not None
    seen = changes(sight)
    old_ns = sight.live.time_ns - 10_000_000_000
    sight.take_point(point(0, time_ns=str(old_ns)))
    sight.take_point(point(1))
    assert [change.kind for change in seen] == ["stored", "point"]
    assert len(sight.points) == 2


def test_points_of_an_earlier_session_are_kept_and_can_be_shown(
    sight: ArmSight,
) -> None:
    first = sight.session
    sight.take_point(point(0))
    sight.take_status(status(session="another"))
    sight.take_point(point(1))  # late, of the session before
    assert not sight.points
    assert sight.earlier_session == first
    sight.shown_session = first
    assert list(sight.points) == ["p-0", "p-1"]
    assert sight.earlier_session is None
    assert sight.last_point is None


def test_figures_are_of_now_only_while_they_come(sight: ArmSight, clock: Clock) -> None:
    sight.take_health(health())
    assert not sight.is_health_stale
    clock.now_s += 11.0
    assert sight.is_health_stale
    sight.take_health(health())
    assert not sight.is_health_stale
    sight.take_live(live(quality=FINE))
    assert verdict(sight).level == "good"
    clock.now_s += 11.0
    sight.take_live(live(quality=FINE))
    assert "is not known" in verdict(sight).sentence
    shown = health()
    waiting = {"unsent": 5, "oldest_unsent_ns": shown.time_ns - 31 * 10**9}
    outbox = shown.outbox.model_copy(update=waiting)
    sight.take_health(shown.model_copy(update={"outbox": outbox}))
    assert verdict(sight).sentence == "5 points wait for the broker."
    sight.take_status(status(online=False, state="offline"))
    assert sight.is_health_stale


def test_alarms_of_before_are_known_from_the_status(sight: ArmSight) -> None:
    """A page that is opened after an alarm began has received no event of it."""
    lost = Alarm(
        severity="error",
        code="outbox.failed",
        source="outbox",
        text="the disk is full",
        remedy="make room",
        since_ns=1,
    )
    sight.take_status(status().model_copy(update={"alarms": (lost,)}))
    assert verdict(sight).level == "bad"
    assert "the disk is full" in verdict(sight).sentence
    # One that ended while the page was cut off is over.
    sight.take_status(status().model_copy(update={"alarms": ()}))
    assert verdict(sight).level == "good"


@pytest.mark.parametrize(
    ("x_mm", "expanded_mm", "level"),
    [
        (0.02, 0.01, "good"),
        (0.045, 0.01, "warning"),
        (0.055, 0.01, "warning"),
        (0.07, 0.01, "bad"),
        (0.02, None, "warning"),
        (0.07, None, "warning"),
    ],
)
def test_nothing_is_proved_within_the_uncertainty_of_the_limit(
    x_mm: float, expanded_mm: float | None, level: str
) -> None:
    off = Nominal((0.0, None, 5.0), 0.05).deviation((x_mm, 99.0, 5.0), expanded_mm)
    assert off.offsets_mm == (x_mm, None, 0.0)
    assert off.distance_mm == pytest.approx(x_mm)
    assert off.decision[0] == level


def test_zero_has_no_minus_and_inches_have_their_digits() -> None:
    assert MM.text(-0.0004) == "0.000"
    assert MM.text(-0.0006) == "-0.001"
    assert MM.text(0.0, sign=True) == "+0.000"
    assert INCH.with_name(25.4) == "1.00000 inch"


def test_in_the_parts_system_the_worst_direction_counts() -> None:
    covariance = (1.0, 0.0, 0.0, 4.0, 0.0, 9.0)
    pose = live(covariance_mm2=list(covariance), quality=FINE)
    assert expanded_axes_mm(pose, "arm") == pytest.approx([2.0, 4.0, 6.0])
    assert expanded_axes_mm(pose, "part") == pytest.approx([6.0, 6.0, 6.0])
    assert expanded_axes_mm(live(covariance_mm2=None), "arm") is None
    assert expanded_axes_mm(None, "arm") is None


def test_an_arm_that_was_never_identified_has_no_uncertainty_and_no_verdict() -> None:
    flags = {"ok": False, "flags": ["geometry_unknown"]}
    covariance = [1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-6]
    pose = live(covariance_mm2=covariance, quality=flags)
    touched = point(0, covariance_mm2=covariance, quality=flags)
    assert expanded_axes_mm(pose, "arm") is None
    assert place_uncertainty(touched, MM) == "geometry unknown"
    known = point(0, covariance_mm2=covariance, quality=FINE)
    assert place_uncertainty(known, MM) == "0.003"
    rows = point_rows([touched], None)
    assert "<td>geometry unknown</td>" in rows
    uncertain = {"ok": False, "flags": ["time_uncertain"]}
    untimed = point(0, covariance_mm2=None, quality=uncertain)
    assert place_uncertainty(untimed, MM) == "time unknown"
    off = Nominal((0.0, 0.0, 0.0), 1.0).deviation((0.0, 0.0, 0.0), None, "why")
    assert off.decision == ("warning", "no verdict: why")


def condition(name: str, **changes: object) -> dict[str, object]:
    usual = {"source": "base", "established": True, "since_ns": "1", "cause": ""}
    return {"name": name, **usual, "remedy": "", "command": "", **changes}


def test_a_condition_that_is_not_established_is_no_green(sight: ArmSight) -> None:
    lost = {"established": False, "cause": "was AAA111, is BBB222", "remedy": "look"}
    conditions = [
        condition("readings"),
        condition("identity", command="reference", **lost),
    ]
    sight.take_status(status(state="doubt", conditions=conditions))
    shown = verdict(sight)
    assert (shown.level, shown.word) == ("warning", "In doubt")
    assert shown.sentence == "base: identity: was AAA111, is BBB222"
    assert shown.remedy == "look"
    assert wanted_commands(sight) == {"reference": ["base: was AAA111, is BBB222"]}
    lost_place = condition("reference", command="reference", **lost)
    sight.take_status(status(state="doubt", conditions=[lost_place]))
    assert set(wanted_commands(sight)) == {"reference", "home"}
    sight.take_status(status(state="doubt", conditions=conditions))
    lines = condition_list(sight)
    assert "1 of 2 conditions of a good number established" in lines
    assert "was AAA111, is BBB222" in lines
    # Its lasting event says the same, and is not counted a second time.
    sight.take_event(
        event("device.identity", True, severity="error", source="base", **SAME)
    )
    assert (verdict(sight).word, verdict(sight).n_others) == ("Alarm", 0)
    sight.take_status(status(conditions=[condition("readings")], alarms=[]))
    assert verdict(sight).word == "Ready"
    lost = {"severity": "error", "source": "arm", "text": "never identified"}
    sight.take_event(event("condition.geometry", True, **lost))
    shown = verdict(sight)  # points can be taken, and are marked
    assert (shown.level, shown.word) == ("warning", "In doubt")


def test_a_daemon_that_falls_silent_is_stale(sight: ArmSight, clock: Clock) -> None:
    sight.take_clock(CLOCK)
    sight.take_health(health())
    sight.take_status(status(conditions=[condition("readings", established=True)]))
    assert verdict(sight).word == "Ready"
    assert "Out of date" not in health_table(sight)
    assert condition_list(sight)
    clock.now_s += 1.6
    sight.take_live(live(quality=FINE))  # cannot come, but would not excuse it
    assert verdict(sight).word == "Stale"
    assert sight.is_stale
    assert obstacle(sight, needs_pose=False)
    assert "Out of date" in health_table(sight)
    assert condition_list(sight) == ""
    sight.take_clock(CLOCK)
    assert verdict(sight).word == "Ready"
    assert not obstacle(sight, needs_pose=True)


def test_a_slow_display_rate_is_not_stale(sight: ArmSight, clock: Clock) -> None:
    clock.now_s += 1.1
    assert sight.is_stale
    for _ in range(3):
        sight.take_live(live(quality=FINE))
        clock.now_s += 2.0
    assert not sight.is_stale
    clock.now_s += 5.0
    assert sight.is_stale


def test_counts_of_a_scan_are_the_arms_wherever_one_begins_to_listen(
    sight: ArmSight,
) -> None:
    begun_late = ArmSight(Clock())
    block = golden(Scan, "scan")
    begun_late.take_scan(block)
    sight.take_scan(block.model_copy(update={"seq": 0, "in_doubt": 3, "last": False}))
    sight.take_scan(block)
    assert begun_late.scan == sight.scan
    assert sight.scan is not None
    assert "161 in doubt" in sight.scan.text


def kept(cloud: Cloud) -> np.ndarray:
    return np.frombuffer(cloud.bytes_from(0), "<f4").reshape(-1, 4)


def add(cloud: Cloud, values: Integers) -> None:
    """Places, whose time [ns] is the value, too."""
    rows = np.column_stack([*[values] * 3, np.zeros(len(values))])
    cloud.add(rows, values.astype(np.int64))


@given(st.lists(st.integers(0, 70), max_size=40), st.sampled_from([2, 8, 32]))
def test_every_kth_point_of_all_is_kept_whatever_the_blocks(
    sizes: list[int], budget: int
) -> None:
    cloud = Cloud(budget)
    n = 0
    for size in sizes:
        add(cloud, np.arange(n, n + size))
        n += size
    assert cloud.n_seen == n
    assert cloud.n_kept <= budget
    expected = np.arange(0, n, cloud.every, dtype=np.float32)
    assert (kept(cloud)[:, 0] == expected).all()
    assert len(expected) == cloud.n_kept
    # It is thinned only when it must be.
    assert cloud.every == 1 or n > (budget - 1) * cloud.every // 2


def test_what_was_handed_out_holds_until_the_version_changes() -> None:
    cloud = Cloud(8)
    add(cloud, np.ones(5))
    version = cloud.version
    first = cloud.bytes_from(0)
    add(cloud, np.full(2, 2))
    assert cloud.version == version
    assert cloud.bytes_from(0)[: len(first)] == first
    assert len(cloud.bytes_from(5)) == 2 * 16
    add(cloud, np.zeros(1))
    assert cloud.version != version


@pytest.mark.parametrize("budget", [8, 1 << 16])
def test_what_an_event_puts_in_doubt_is_marked(sight: ArmSight, budget: int) -> None:
    cloud, seen = Cloud(budget), changes(sight)
    sight.doubt_listeners.append(cloud.doubt)
    sight.scan_listeners.append(cloud.take)
    for n in (0, 30):
        add(cloud, np.arange(n, n + 30))
    held = point(1, quality=FINE)
    sight.take_point(held)
    version = cloud.version
    sight.take_doubt(doubt(20, held.time_ns))
    assert cloud.version != version
    assert (kept(cloud)[:, 3] == (kept(cloud)[:, 0] >= 20)).all()
    assert sight.points[held.id].quality.flags == ("stale",)
    assert [change.kind for change in seen] == ["point", "doubt"]


def test_another_scan_begins_anew() -> None:
    cloud = Cloud(8)
    add(cloud, np.ones(20))
    version = cloud.version
    cloud.clear()
    assert (cloud.n_kept, cloud.n_seen, cloud.every) == (0, 0, 1)
    assert cloud.version != version
