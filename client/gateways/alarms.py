"""Trust in an arm, by its status."""

from collections.abc import Container

from traverse.protocol.messages import Status


def alarm_of(status: Status, *, ignored: Container[str] = ()) -> str | None:
    """Return why the arm cannot be trusted, for people; None if it can.

    Args:
        status: of the arm.
        ignored: codes of alarms that do not count.
    """
    if not status.online:
        return "the arm is offline"
    for alarm in status.alarms:
        if alarm.severity != "info" and alarm.code not in ignored:
            return f"alarm {alarm.code}: {alarm.text}; {alarm.remedy}"
    return None
