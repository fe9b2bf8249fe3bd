"""Event: something happened that a person or program should know."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from traverse.protocol.messages.fields import (
    ArmName,
    Count,
    Message,
    Name,
    Text,
    TimeNs,
    schema_field,
)
from traverse.protocol.messages.plain import PlainMap

Severity = Literal["info", "warning", "error"]
EventCode = Annotated[
    str, Field(pattern=r"^[a-z][a-z0-9_]*(\.[a-z0-9_]+)+$", max_length=64)
]


class Event(Message):
    """A button, alarm, fault, limit or label.

    Repetitions of one `code` from one `source` may be one message: `count` of them
    between `first_ns` and `last_ns`. A lasting condition is raised and later cleared by
    two events of the same `code` and `source`.
    """

    schema_: Literal["traverse/event/1"] = schema_field("traverse/event/1")
    arm: ArmName
    """Name of the arm."""
    session: Name | None
    """Session at that time; null before the first."""
    severity: Severity
    """"error": measuring is not possible or a loss occurred."""
    code: EventCode
    """What happened, for programs, in dotted words: "device.lost"."""
    text: Text
    """What happened, for people: what, where, observed value."""
    remedy: Text
    """What to do about it; empty where nothing needs to be done."""
    source: Name
    """What it concerns: "<device id>", "<device id>/<channel>", "broker", ..."""
    active: bool | None
    """True: raised; false: cleared; null: momentary."""
    first_ns: TimeNs
    """When it happened first. [UTC]"""
    last_ns: TimeNs
    """When it happened last. [UTC]"""
    count: Annotated[Count, Field(ge=1)]
    """How often it happened from first_ns to last_ns."""
    data: PlainMap
    """Values that belong to the code; names carry their units."""

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        if self.last_ns < self.first_ns:
            raise ValueError("last_ns not before first_ns")
        return self
