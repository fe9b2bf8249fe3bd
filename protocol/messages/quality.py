"""Quality of a point or sample: the one table of flags, as bits and as names."""

from enum import IntFlag
from functools import lru_cache
from typing import Annotated, Self

from pydantic import Field, model_validator

from traverse.protocol.messages.fields import Value, Word


class QualityFlag(IntFlag):
    """The bits of `quality` in a scan; their names in lower case stand in points."""

    ENCODER_ERROR = 1 << 0
    ENCODER_WARNING = 1 << 1
    LATE = 1 << 2
    STALE = 1 << 3
    INCOMPLETE = 1 << 4
    OVERSPEED = 1 << 5
    END_STOP = 1 << 6
    SINGULAR = 1 << 7
    TEMPERATURE = 1 << 8
    STALE_IDENTIFICATION = 1 << 9
    STALE_EFFECT = 1 << 10
    SURFACE_UNKNOWN = 1 << 11
    TIME_UNCERTAIN = 1 << 12
    TURNS_UNCERTAIN = 1 << 13
    INTERPOLATED = 1 << 14
    EMPIRICAL = 1 << 15
    BEYOND_KNOTS = 1 << 16
    TEMPERATURE_UNKNOWN = 1 << 17
    MOTION_UNKNOWN = 1 << 18
    SKEW = 1 << 19
    GEOMETRY_UNKNOWN = 1 << 20
    IDENTITY_UNCONFIRMED = 1 << 21
    UTC_UNCERTAIN = 1 << 22


FLAG_MEANINGS = {
    QualityFlag.ENCODER_ERROR: "an encoder says that its count is not valid",
    QualityFlag.ENCODER_WARNING: "an encoder warns: valid count, weak signal; or bytes "
    "near it were spoilt, and no check sum tells which",
    QualityFlag.LATE: "a count was not latched at the common instant",
    QualityFlag.STALE: "a count is repeated from an earlier latch",
    QualityFlag.INCOMPLETE: "a joint's count is missing; one of another time was used",
    QualityFlag.OVERSPEED: "the probe moved faster than the configured limit",
    QualityFlag.END_STOP: "a joint is near its end stop",
    QualityFlag.SINGULAR: "the posture is near to losing a degree of freedom",
    QualityFlag.TEMPERATURE: "the temperature, or its rate, is out of its band, or "
    "it is not known though a band is set",
    QualityFlag.STALE_IDENTIFICATION: "the identification is older than allowed",
    QualityFlag.STALE_EFFECT: "a correction bound to time is used beyond its time",
    QualityFlag.SURFACE_UNKNOWN: "a correction needs the surface's direction: left out",
    QualityFlag.TIME_UNCERTAIN: "the device's clock is not yet tied to the host's, or "
    "the host's was set",
    QualityFlag.TURNS_UNCERTAIN: "counts restarted, or a joint was not read for a "
    "while: place or turns are assumed",
    QualityFlag.INTERPOLATED: "interpolated between samples, not latched at the edge",
    QualityFlag.EMPIRICAL: "corrected by an empirical effect, with no known cause",
    QualityFlag.BEYOND_KNOTS: "an empirical effect is held, beyond what was measured",
    QualityFlag.TEMPERATURE_UNKNOWN: "a correction lacks the temperature: taken as the "
    "arm file's reference",
    QualityFlag.MOTION_UNKNOWN: "a correction, or a limit of speed, lacks the speed or "
    "last sense of a motion: left out",
    QualityFlag.SKEW: "joints were read at different instants, and the arm moved so "
    "that the point may be off by more than the limit",
    QualityFlag.GEOMETRY_UNKNOWN: "the arm's geometry has not been identified with a "
    "covariance: how far a point is off is not known",
    QualityFlag.IDENTITY_UNCONFIRMED: "a device is not the one that was confirmed, or "
    "was never confirmed",
    QualityFlag.UTC_UNCERTAIN: "the computer's UTC cannot be believed",
}
"""What each flag says."""

_NAMES = {flag.value: flag.name.lower() for flag in FLAG_MEANINGS if flag.name}

REMARKS = QualityFlag.INTERPOLATED | QualityFlag.EMPIRICAL
"""Flags that tell how a value came about; all others make `ok` false."""


def flag_names(bits: int) -> tuple[str, ...]:
    """The names of the bits that are set, lowest first; `bit_n` for unknown ones."""
    return tuple(
        _NAMES.get(1 << i, f"bit_{i}")
        for i in range(bits.bit_length())
        if bits >> i & 1
    )


class Quality(Value):
    """Whether a measurement may be trusted, and reasons for doubt."""

    ok: bool
    """False if any flag other than a remark is set: the accuracy is in doubt."""
    flags: Annotated[tuple[Word, ...], Field(max_length=32)]
    """Names from the table of quality flags; later versions may add some."""

    @classmethod
    @lru_cache(maxsize=256)  # one never changes, and most points have the same few
    def from_bits(cls, bits: int) -> Self:
        return cls(ok=not bits & ~REMARKS.value, flags=flag_names(bits))

    @model_validator(mode="after")
    def _gives_a_reason(self) -> Self:
        if not self.ok and not self.flags:
            raise ValueError("a flag that says why ok is false")
        return self
