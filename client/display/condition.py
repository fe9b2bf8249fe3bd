"""How the arm is, in one sentence and with what to do about it."""

from dataclasses import dataclass
from typing import Literal

from traverse.client.display.arm_state import ArmSight

Level = Literal["good", "warning", "bad"]
UNSENT_WARNING = 100


@dataclass(frozen=True, slots=True)
class Verdict:
    """The banner's text.

    Attributes:
        level: "bad" where measuring is not possible or the values are out of date.
        sentence, remedy: for people.
        others: how many more conditions there are.
    """

    level: Level
    sentence: str
    remedy: str = ""
    others: int = 0


def verdict(sight: ArmSight) -> Verdict:
    """The worst current condition."""
    found = list(_conditions(sight))
    if not found:
        return Verdict("good", "Ready to measure.")
    worst = min(found, key=lambda one: one.level != "bad")
    return Verdict(worst.level, worst.sentence, worst.remedy, len(found) - 1)


def _conditions(sight: ArmSight) -> list[Verdict]:
    if not sight.is_linked:
        return [
            Verdict(
                "bad",
                f"No connection to the broker: {sight.link_reason}.",
                "These values are out of date. Start the broker or check the network; "
                "the arm keeps its points and this page reconnects by itself.",
            )
        ]
    status = sight.status
    if status is None or not status.online:
        told = "has never published its status" if status is None else "is off line"
        return [
            Verdict(
                "bad",
                f"The arm {told}.",
                "Start its daemon: systemctl start traverse, or traverse run.",
            )
        ]
    found = [
        Verdict(
            "bad" if e.severity == "error" else "warning",
            f"{e.source}: {e.text}",
            e.remedy,
        )
        for e in sight.alarms.values()
        if e.severity != "info"
    ]
    if not found and status.state == "degraded":
        off = ", ".join(d.id for d in status.drivers if d.state != "ready")
        found.append(
            Verdict(
                "bad",
                f"Not all devices are there: {off}.",
                "Check cables and power; the daemon looks for them again by itself.",
            )
        )
    if not found and sight.is_stale:
        found.append(
            Verdict(
                "bad",
                f"No pose for {sight.age_s:.0f} s." if sight.live else "No pose yet.",
                "Look at the devices below; move the arm.",
            )
        )
    health = sight.health
    if health is not None:
        if health.outbox.state == "failed":
            found.append(
                Verdict("bad", "Points cannot be kept on disk.", "Free the disk.")
            )
        elif health.outbox.unsent > UNSENT_WARNING:
            told = f"{health.outbox.unsent} points wait for the broker."
            found.append(Verdict("warning", told, "They are safe on the arm's disk."))
    live = sight.live
    if live is not None and not live.quality.ok and not found:
        flags = ", ".join(f.replace("_", " ") for f in live.quality.flags)
        found.append(
            Verdict(
                "warning",
                f"A point taken here would be in doubt: {flags}.",
                "See what the flag means in the reference of messages.",
            )
        )
    return found
