"""Faults on request: of the line, of an encoder, of the whole board."""

import math
from collections.abc import Iterable, Mapping
from typing import Annotated

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    SerializeAsAny,
    field_validator,
)

from traverse.strict_toml.reader import StrictModel


class Fault(StrictModel):
    """A fault; `at_s` counts from the start of the script.

    Without `duration_s` a fault lasts, without `device` it is of all devices.
    """

    kind: str
    device: str | None = None
    at_s: float = Field(default=0.0, ge=0.0)
    duration_s: float = Field(default=math.inf, gt=0.0, allow_inf_nan=True)

    @classmethod
    def variant(cls, table: object) -> "type[Fault]":
        """Select the class of a table by its kind."""
        kind = table.get("kind") if isinstance(table, Mapping) else None
        return FAULTS.get(str(kind), UnknownFault)

    def lasts(self, script_s: float) -> bool:
        """Whether it is there at a time of the script."""
        return self.at_s <= script_s < self.at_s + self.duration_s


class UnknownFault(Fault):
    """What is of no known kind: refused for that alone, not for its other keys."""

    model_config = ConfigDict(extra="ignore")

    @field_validator("kind")
    @classmethod
    def _refuse(cls, kind: str) -> str:
        known = ", ".join(sorted(FAULTS))
        raise ValueError(f"unknown kind of fault '{kind}'; known: {known}")


class LineFault(Fault):
    """Frames that are lost, corrupted, repeated, lack a byte, or follow on garbage.

    With `channel` only what one encoder sends, where each answers by itself.
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


class StatusFault(EncoderFault):
    """An encoder that reports its count as invalid or doubtful.

    `bits` are those of the board's status: 1 error, 2 warning.
    """

    bits: int = Field(default=1, ge=1, le=0xFF)
    code: int = Field(default=2, ge=1, le=0xFFFF)
    value: int = Field(default=0, ge=-(2**31), le=2**31 - 1)


class BoardFault(Fault):
    """A device that disappears for a time."""

    duration_s: float = Field(gt=0.0)


class SpeakerFault(BoardFault):
    """A device, or one encoder where each answers by itself, that sends nothing.

    After `silent` it continues as before, after `reset` it has lost power; `duplicate`
    is the contrary: it sends everything twice, as two encoders with one number do.
    """

    channel: int | None = Field(default=None, ge=0)


class EmcyFault(Fault):
    """An emergency message of an encoder; the error ends with the fault.

    Attributes:
        code: Emergency error code.
        error_register: Object 1001.
        alarms: Bits of CiA 406 that are set meanwhile.
        warnings: The same of the warnings.
    """

    channel: int = Field(ge=0)
    code: int = Field(default=0x1000, ge=1, le=0xFFFF)
    error_register: int = Field(default=1, ge=0, le=0xFF)
    alarms: int = Field(default=1, ge=0, le=0xFFFF)
    warnings: int = Field(default=0, ge=0, le=0xFFFF)


FAULTS: dict[str, type[Fault]] = {
    "lost": LineFault,
    "corrupted": LineFault,
    "repeated": LineFault,
    "garbage": LineFault,
    "cut": LineFault,
    "check": LineFault,
    "late": LateFault,
    "stuck": EncoderFault,
    "jump": JumpFault,
    "status": StatusFault,
    "gone": BoardFault,
    "silent": SpeakerFault,
    "reset": SpeakerFault,
    "emcy": EmcyFault,
    "duplicate": SpeakerFault,
    "bus_off": BoardFault,
}


def fault_from_table(table: object) -> Fault:
    """Make a fault of the class of its kind."""
    return (
        table
        if isinstance(table, Fault)
        else Fault.variant(table).model_validate(table)
    )


AnyFault = Annotated[SerializeAsAny[Fault], BeforeValidator(fault_from_table)]


def of_device(
    faults: Iterable[Fault], device: str, played: frozenset[str]
) -> tuple[Fault, ...]:
    """Pick the faults that concern a device and are of the kinds that it plays."""
    return tuple(
        fault
        for fault in faults
        if fault.device in {None, device} and fault.kind in played
    )
