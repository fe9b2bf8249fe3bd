"""Condition of the arm in one sentence, with the remedy."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

from traverse.client.display.arm_state import ArmSight
from traverse.client.display.figures import flag_words
from traverse.plurals import counted
from traverse.protocol.messages import Alarm, ConditionStanding, Event, Health, Live

Level = Literal["good", "busy", "warning", "bad"]
GRAVEST_FIRST: tuple[Level, ...] = ("bad", "warning", "busy")
UNSENT_WARNING = 100
UNSENT_WARNING_NS = 30 * 10**9
TURNS_UNCERTAIN = "device.turns_uncertain"
REMEDIES = {
    "encoder_error": "Look at the alarms of this encoder below; check its mounting.",
    "incomplete": "Check the devices below.",
    "overspeed": "Move slower.",
    "end_stop": "Turn the joint that is at its end stop back.",
    "singular": "Bend the arm more.",
    "temperature": "Wait until the temperature has settled.",
    "temperature_unknown": "Connect the arm's temperature sensor.",
    "stale_identification": "Identify the arm again.",
    "stale_effect": "Identify the arm again.",
    "time_uncertain": "Wait some seconds at rest.",
    "turns_uncertain": "Reference the arm, touch a known point, then confirm.",
    "geometry_unknown": "Identify the arm: until then no uncertainty can be stated.",
    "identity_unconfirmed": "Look which device was exchanged, then confirm.",
    "utc_uncertain": "Set the computer's clock.",
    "skew": "Hold the arm still while you take a point.",
}
"""Remedies for flags; others are described by their names."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The banner's text.

    Attributes:
        level: "bad" if measuring is impossible or the values are out of date; "busy" if
            the arm is well and does something that people must know.
        word: readable at 2 m.
        activity: a scan that runs besides.
    """

    level: Level
    word: str
    sentence: str
    remedy: str = ""
    n_others: int = 0
    activity: str = ""

    @property
    def text(self) -> str:
        """The sentence, the number of other conditions, and the current activity."""
        suppressed = f" (and {self.n_others} more)" if self.n_others else ""
        return " ".join(filter(None, (self.sentence + suppressed, self.activity)))


def verdict(sight: ArmSight) -> Verdict:
    """Return the worst current condition, with the number of others."""
    conditions = list(_conditions(sight))
    scan = sight.scan
    activity = f"{scan.text}." if scan is not None and scan.runs else ""
    if not conditions:
        if activity:
            return Verdict("busy", "Scanning", activity)
        return Verdict("good", "Ready", "Ready to measure.")
    worst = min(conditions, key=lambda condition: GRAVEST_FIRST.index(condition.level))
    if not sight.is_online:
        activity = ""
    return replace(worst, n_others=len(conditions) - 1, activity=activity)


def obstacle(sight: ArmSight, *, needs_pose: bool) -> str:
    """Return why a command cannot be carried out; empty if it can be tried."""
    is_reached = sight.is_online and not sight.is_silent
    if not is_reached or (needs_pose and sight.is_stale):
        return verdict(sight).sentence
    return ""


def lost_conditions(sight: ArmSight) -> list[ConditionStanding]:
    """Return conditions that are not established; none while unknown."""
    status = sight.status
    if status is None or not sight.is_online:
        return []
    return [condition for condition in status.conditions if not condition.established]


def condition_words(lost: ConditionStanding) -> str:
    """Describe conditions in doubt, with subjects and causes."""
    cause = lost.cause.removeprefix(f"{lost.source}: ")
    return f"{lost.source}: {lost.name.replace('_', ' ')}: {cause}"


def wanted_commands(sight: ArmSight) -> dict[str, list[str]]:
    causes_of: dict[str, list[str]] = {}
    for condition in lost_conditions(sight):
        # Encoders that count from where they are can be homed instead.
        home = "home" if condition.name == "reference" else ""
        names = {condition.command, home} - {""}
        if (
            condition.name == "utc"
        ):  # confirmed by itself, if nothing of the arm has to be
            names = {"utc"}
        for name in names:
            causes_of.setdefault(name, []).append(
                f"{condition.source}: {condition.cause}"
            )
    flags = sight.live.quality.flags if sight.live and not sight.is_stale else ()
    if "turns_uncertain" in flags:
        causes_of.setdefault("reference", [])
        causes_of.setdefault("home", [])
    return causes_of


def _conditions(sight: ArmSight) -> Iterator[Verdict]:
    status, health, live = sight.status, sight.health, sight.live
    if (absence := _absence(sight)) is not None:
        yield absence
        return
    if status is None:
        return
    alarms = [_of_alarm(e) for e in sight.alarms.values() if e.severity != "info"]
    yield from alarms
    shown = {(alarm.source, alarm.text) for alarm in sight.alarms.values()}
    for lost in lost_conditions(sight):
        if (lost.source, lost.cause) not in shown:
            yield Verdict("warning", "In doubt", condition_words(lost), lost.remedy)
    if not alarms and status.state == "degraded":
        off = ", ".join(d.id for d in status.drivers if d.state != "ready")
        yield Verdict(
            "bad",
            "Device gone",
            f"Not all devices are there: {off}.",
            "Check cables and power; the daemon looks for them again by itself.",
        )
    elif sight.is_stale and not any(active.level == "bad" for active in alarms):
        yield Verdict(
            "bad",
            "No pose",
            f"No pose for {sight.age_s:.0f} s." if live else "No pose yet.",
            "Look at the devices below; move the arm.",
        )
    if health is not None and not sight.is_health_stale:
        if health.outbox.state == "failed":
            yield Verdict(
                "bad", "No points", "Points cannot be kept on disk.", "Free the disk."
            )
        elif is_waiting(health):
            statement = (
                f"{counted(health.outbox.unsent, 'point', 'wait')} for the broker."
            )
            yield Verdict(
                "warning", "Wait", statement, "They are safe on the arm's disk."
            )
    elif sight.is_health_missing:
        yield Verdict(
            "warning",
            "In doubt",
            "Whether points reach the broker is not known.",
            "No figures come from the arm: look at the broker's access list.",
        )
    if live is not None and not live.quality.ok and not sight.is_stale:
        yield _of_pose(live)


def is_waiting(health: Health) -> bool:
    """Whether many points wait for the broker, or one for long."""
    outbox = health.outbox
    oldest_ns = (
        health.time_ns if outbox.oldest_unsent_ns is None else outbox.oldest_unsent_ns
    )
    waits_ns = health.time_ns - oldest_ns
    return outbox.unsent > UNSENT_WARNING or waits_ns > UNSENT_WARNING_NS


def _absence(sight: ArmSight) -> Verdict | None:
    """Why nothing is known of the arm now; None: messages arrive."""
    status = sight.status
    if not sight.is_linked:
        return Verdict(
            "bad",
            "Broker gone",
            f"No connection to the broker: {sight.link_reason}.",
            "These values are out of date. Start the broker or check the network; "
            "the arm keeps its points and this page reconnects by itself.",
        )
    if status is None or not status.online:
        statement = "The arm is off line"
        if status is None:
            absence = sight.absence
            statement = (
                absence[:1].upper() + absence[1:] or "The arm has sent no status yet"
            )
        return Verdict(
            "bad",
            "Arm gone",
            f"{statement}.",
            "Start its daemon: systemctl start traverse, or traverse run.",
        )
    if sight.is_silent:
        return Verdict(
            "bad",
            "Stale",
            f"Nothing has arrived from the arm for {sight.silence_s:.0f} s.",
            "These values are out of date, and commands are not sent. Look whether its "
            "daemon and the broker run, and at the network.",
        )
    return None


def _of_pose(live: Live) -> Verdict:
    flags = live.quality.flags
    if flags == ("overspeed",):  # matters for points, not for moving
        return Verdict("busy", "Moving", "Too fast to take a point now.")
    return Verdict(
        "warning",
        "In doubt",
        f"A point taken here would be in doubt: {flag_words(live)}.",
        " ".join(REMEDIES[flag] for flag in flags if flag in REMEDIES),
    )


def _of_alarm(alarm: Event | Alarm) -> Verdict:
    # Without a condition of good numbers measuring goes on, and points are marked.
    is_doubt = alarm.code == TURNS_UNCERTAIN or alarm.code.startswith("condition.")
    is_grave = alarm.severity == "error" and not is_doubt
    return Verdict(
        "bad" if is_grave else "warning",
        "Alarm" if is_grave else "In doubt",
        f"{alarm.source}: {alarm.text}",
        alarm.remedy,
    )
