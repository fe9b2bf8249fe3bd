"""Status: who is there, retained by the broker and left as the last will."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from traverse.protocol.messages.event import EventCode, Severity
from traverse.protocol.messages.fields import (
    ArmName,
    Digest,
    Message,
    Name,
    Text,
    TimeNs,
    Value,
    Word,
    schema_field,
)
from traverse.protocol.messages.later_doubt import LaterDoubt
from traverse.protocol.messages.plain import PlainMap
from traverse.protocol.messages.point import Label


class DriverStatus(Value):
    """One device of the daemon's configuration."""

    id: Name
    """Name of the device in the configuration."""
    driver: Name
    """Kind of driver, for example "latch-board"."""
    port: Text
    """Port or bus, as configured."""
    state: Literal["starting", "ready", "lost", "failed", "stopped"]
    """"lost": the daemon tries to find it again; "failed": cannot be used as it is."""
    identity: PlainMap
    """What the device reports of itself (board, firmware, serial numbers), or empty."""


class Alarm(Value):
    """A lasting condition that has begun and not ended; see its event."""

    severity: Severity
    """That of its event."""
    code: EventCode
    """That of its event."""
    source: Name
    """What it concerns, as in its event."""
    text: Text
    """For people: what, where, observed value."""
    remedy: Text
    """What to do about it."""
    since_ns: TimeNs
    """When it began. [UTC]"""


class ConditionStanding(Value):
    """Whether one condition that numbers rest on is established."""

    name: Word
    """Of the condition, from the table of conditions."""
    source: Name
    """What it concerns: a device, "arm" for the arm, "host" for the computer."""
    established: bool
    """While any is false, numbers are in doubt."""
    since_ns: TimeNs
    """Since when it is so. [UTC]"""
    cause: Text
    """Why it is not established, for people; empty where it is."""
    remedy: Text
    """What to do about it; empty where nothing is to be done."""
    command: Annotated[str, Field(max_length=32)]
    """Command by which the operator establishes it; empty where there is none."""


class Status(Message):
    """The daemon's state: retained, sent at every change, and its last will."""

    schema_: Literal["traverse/status/1"] = schema_field("traverse/status/1")
    online: bool
    """False in the last will and after an orderly stop."""
    state: Literal["starting", "ready", "doubt", "degraded", "stopping", "offline"]
    """"ready": every number is `ok` now, as far as no single one is marked; "doubt":
    all is there, but a condition is not established; "degraded": something configured
    is missing; see `conditions`, `drivers` and events."""
    arm: ArmName
    """Name of the arm, as in the topic."""
    model: Digest | None
    """Digest of the arm file in use; null before it is read."""
    version: Name
    """Version of the daemon."""
    kernel: Word
    """Kinematic computation: "numpy", or "portable", "avx2", "avx512" in C."""
    encoding: Literal["msgpack", "json"]
    """Encoding of all payloads of this arm."""
    session: Name | None
    """Session that new points belong to; null before the first."""
    time_ns: TimeNs
    """When this was written; in the last will, when the connection was made. [UTC]"""
    drivers: Annotated[tuple[DriverStatus, ...], Field(max_length=64, fail_fast=True)]
    """All configured devices."""
    alarms: Annotated[tuple[Alarm, ...], Field(max_length=64)] = ()
    """Lasting conditions, oldest first, at most 64; empty in the last will."""
    conditions: Annotated[
        tuple[ConditionStanding, ...], Field(max_length=256, fail_fast=True)
    ] = ()
    """All conditions that numbers rest on; empty in the last will."""
    doubts: Annotated[tuple[LaterDoubt, ...], Field(max_length=16)] = ()
    """The latest 16, oldest first; empty in the last will. Those of what is sent again
    are in the reply to `resend`."""
    probe: Name | None = None
    """Probe of the library that measures; null: that of the arm file."""
    probes: Annotated[tuple[Name, ...], Field(max_length=64)] | None = None
    """Probes of the library when it was last read, at most 64; null without one."""
    label: Label | None = None
    """What the next points are taken on; null in the last will."""
    alignment: Text | None = None
    """Name of the alignment to the part; empty: without a name; null: no alignment."""
    public_key: Annotated[str, Field(pattern="^[A-Za-z0-9+/]{43}=$")] | None = None
    """Ed25519 key by which points are signed, base 64; null: they are not."""

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        if self.online == (self.state == "offline"):
            raise ValueError('online false with state "offline", true with any other')
        return self
