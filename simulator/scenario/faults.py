"""Faults on request: of the line, of an encoder, of the whole board."""

import math
from collections.abc import Iterable
from typing import Annotated, ClassVar

from pydantic import (
    BeforeValidator,
    Field,
    SerializeAsAny,
)

from traverse.simulator.kind_table import KindTable


class Fault(KindTable):
    """A fault; `at_s` counts from the start of the script.

    Without `duration_s` it lasts, without `device` it is of all devices.
    """

    FAMILY = "fault"
    KINDS: ClassVar[dict[str, type["Fault"]]] = {}

    device: str | None = None
    at_s: float = Field(default=0.0, ge=0.0)
    duration_s: float = Field(default=math.inf, gt=0.0, allow_inf_nan=True)

    def lasts(self, script_s: float) -> bool:
        return self.at_s <= script_s < self.at_s + self.duration_s

    def strikes(self, script_s: float, channel: int | None) -> bool:
        """Return whether it lasts for a channel; None: for the device as a whole."""
        own_channel = getattr(self, "channel", None)
        return self.lasts(script_s) and own_channel in {None, channel}


class LineFault(Fault):
    """Frames that are lost, corrupted, repeated, lack a byte, or follow on garbage.

    With `channel` only one encoder's, if each answers by itself.
    """

    probability: float = Field(gt=0.0, le=1.0)
    seed: int = Field(default=0, ge=0)
    channel: int | None = Field(default=None, ge=0)


class LateFault(LineFault):
    """Answers that are late."""

    delay_s: float = Field(gt=0.0)


class EncoderFault(Fault):
    """An encoder whose count is constant."""

    channel: int = Field(ge=0)


class JumpFault(EncoderFault):
    """An encoder that is off by a step."""

    step_counts: int


class UnreadFault(EncoderFault):
    """An encoder that is not read now and then: its last count is repeated.

    Attributes:
        probability: that a read fails after one that did not.
        most: reads that fail in a row.
    """

    probability: float = Field(gt=0.0, le=1.0)
    most: int = Field(default=1, ge=1, le=1000)
    seed: int = Field(default=0, ge=0)


class StatusFault(EncoderFault):
    """An encoder that reports its count as invalid or doubtful.

    `bits` as in the board's status: 1 error, 2 warning.
    """

    bits: int = Field(default=1, ge=1, le=0xFF)
    code: int = Field(default=2, ge=1, le=0xFFFF)
    value: int = Field(default=0, ge=-(2**31), le=2**31 - 1)


class BoardFault(Fault):
    """A device that disappears for a time."""

    duration_s: float = Field(gt=0.0)


class SpeakerFault(BoardFault):
    """A device, or one encoder that answers by itself, that sends nothing.

    After `silent` it continues as before, after `reset` it has lost power; `duplicate`
    sends everything twice, as two encoders with one number do.
    """

    channel: int | None = Field(default=None, ge=0)


class EmcyFault(Fault):
    """An emergency message of an encoder; the error ends with the fault.

    Attributes:
        error_register: object 1001.
        alarms: bits of CiA 406 that are set meanwhile.
        warnings: bits of the warnings.
    """

    channel: int = Field(ge=0)
    code: int = Field(default=0x1000, ge=1, le=0xFFFF)
    error_register: int = Field(default=1, ge=0, le=0xFF)
    alarms: int = Field(default=1, ge=0, le=0xFFFF)
    warnings: int = Field(default=0, ge=0, le=0xFFFF)


Fault.KINDS.update(
    {
        "lost": LineFault,
        "corrupted": LineFault,
        "repeated": LineFault,
        "garbage": LineFault,
        "cut": LineFault,
        "check": LineFault,
        "late": LateFault,
        "stuck": EncoderFault,
        "jump": JumpFault,
        "unread": UnreadFault,
        "status": StatusFault,
        "gone": BoardFault,
        "silent": SpeakerFault,
        "reset": SpeakerFault,
        "emcy": EmcyFault,
        "duplicate": SpeakerFault,
        "bus_off": BoardFault,
    }
)
AnyFault = Annotated[SerializeAsAny[Fault], BeforeValidator(Fault.from_table)]


def of_device(
    faults: Iterable[Fault], device: str, played: frozenset[str]
) -> tuple[Fault, ...]:
    return tuple(
        fault
        for fault in faults
        if fault.device in {None, device} and fault.kind in played
    )
