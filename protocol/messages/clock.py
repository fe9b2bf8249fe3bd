"""Clock: the daemon's own time, in which a command states until when it is valid."""

from typing import Literal

from traverse.protocol.messages.fields import (
    ArmName,
    Message,
    Name,
    TimeNs,
    Value,
    schema_field,
)


class Clock(Message):
    """The daemon's own clock, twice a second, so that commands can expire by it.

    A command that is sent s nanoseconds after this was received, and states `now_ns` +
    s + 5 s in its `expires`, is executed within 5 s or not at all, wherever it waits
    and whatever UTC the two computers have.
    """

    schema_: Literal["traverse/clock/1"] = schema_field("traverse/clock/1")
    arm: ArmName
    """Name of the arm."""
    clock: Name
    """Name of this clock: another one after each start of the daemon."""
    now_ns: TimeNs
    """Nanoseconds by this clock, which never steps and has no relation to UTC."""


class Expiry(Value):
    """An instant by the daemon's own clock."""

    clock: Name
    """Name of the clock, from its message."""
    at_ns: TimeNs
    """Nanoseconds by that clock."""
