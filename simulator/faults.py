"""Faults on request: of the line, of an encoder, of the whole board."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    SerializeAsAny,
    field_validator,
)

from kinematics.arm_file import StrictModel


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
        """Say the class of a table by its kind."""
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
    """Frames that are lost, corrupted, repeated, or have garbage before them."""

    probability: float = Field(gt=0.0, le=1.0)
    seed: int = Field(default=0, ge=0)


class EncoderFault(Fault):
    """An encoder whose count stands still."""

    channel: int = Field(ge=0)


class JumpFault(EncoderFault):
    """An encoder that is off by a step."""

    step_counts: int


class StatusFault(EncoderFault):
    """An encoder that says that its count is not valid."""

    code: int = Field(default=2, ge=1, le=0xFFFF)
    value: int = Field(default=0, ge=-(2**31), le=2**31 - 1)


class BoardFault(Fault):
    """A board that goes away or says nothing for a time."""

    duration_s: float = Field(gt=0.0)


FAULTS: dict[str, type[Fault]] = {
    "lost": LineFault,
    "corrupted": LineFault,
    "repeated": LineFault,
    "garbage": LineFault,
    "stuck": EncoderFault,
    "jump": JumpFault,
    "status": StatusFault,
    "gone": BoardFault,
    "silent": BoardFault,
}


def fault_from_table(table: object) -> Fault:
    """Make a fault of the class that its kind asks for."""
    return (
        table
        if isinstance(table, Fault)
        else Fault.variant(table).model_validate(table)
    )


AnyFault = Annotated[SerializeAsAny[Fault], BeforeValidator(fault_from_table)]


@dataclass(slots=True)
class FaultCounts:
    """How often the line was disturbed."""

    lost: int = 0
    corrupted: int = 0
    repeated: int = 0
    garbage: int = 0
    silenced: int = 0


@dataclass(slots=True)
class DisturbedLine:
    """What is between the board and the port.

    Attributes:
        faults: Of the line, and `silent` ones.
        counts: What was done so far.
    """

    faults: tuple[Fault, ...]
    seed: int
    counts: FaultCounts = field(default_factory=FaultCounts)
    _draws: list[np.random.Generator] = field(init=False)

    def __post_init__(self) -> None:
        self._draws = [
            np.random.default_rng([self.seed, number, getattr(fault, "seed", 0)])
            for number, fault in enumerate(self.faults)
        ]

    def disturb(self, frame: bytes, script_s: float) -> bytes:
        """Give the bytes that go out for a frame; none if it is lost."""
        for fault, draw in zip(self.faults, self._draws, strict=True):
            if fault.lasts(script_s):
                if fault.kind == "silent":
                    self.counts.silenced += 1
                    return b""
                if isinstance(fault, LineFault) and draw.random() < fault.probability:
                    frame = self._strike(fault.kind, frame, draw)
        return frame

    def _strike(self, kind: str, frame: bytes, draw: np.random.Generator) -> bytes:
        setattr(self.counts, kind, getattr(self.counts, kind) + 1)
        if kind == "lost":
            return b""
        if kind == "repeated":
            return frame + frame
        if kind == "garbage":
            return draw.bytes(int(draw.integers(1, 65))) + frame
        struck = bytearray(frame)
        if struck:
            bit = int(draw.integers(8 * len(struck)))
            struck[bit // 8] ^= 1 << bit % 8
        return bytes(struck)


def of_device(faults: Iterable[Fault], device: str) -> tuple[Fault, ...]:
    """Pick the faults that concern a device."""
    return tuple(fault for fault in faults if fault.device in {None, device})
