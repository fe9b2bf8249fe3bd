"""Arm files: strict reading, and writing that keeps every number."""

import hashlib
from collections.abc import Mapping
from datetime import date, datetime
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AwareDatetime,
    BeforeValidator,
    ConfigDict,
    Field,
    SerializeAsAny,
    create_model,
    field_validator,
)

from traverse.kinematics.arm_file.checks import arm_problems
from traverse.kinematics.effect_table import EFFECT_KINDS, Vector
from traverse.strict_toml.problems import (
    FileError,
    toml_text,
    unknown_name_message,
)
from traverse.strict_toml.reader import (
    StrictModel,
    parse_strict,
    read_strict,
    tuples_for_lists,
)
from traverse.strict_toml.writing import canonical_text, write_atomically


class Encoder(StrictModel):
    """How counts become radians: reading = sign 2 pi counts / counts_per_turn."""

    counts_per_turn: int = Field(ge=1, le=2**32)
    sign: int
    source: str
    absolute: bool | None = None

    @field_validator("sign")
    @classmethod
    def _checked_sign(cls, sign: int) -> int:
        if sign not in (1, -1):
            raise ValueError(f"{sign} is not valid here; expected 1 or -1")
        return sign

    @property
    def device_id(self) -> str:
        return self.source.partition("/")[0]

    @property
    def channel(self) -> int:
        return int(self.source.partition("/")[2])


class Joint(StrictModel):
    """A hinge and the element that it carries, in the base posture."""

    name: str
    axis: Vector
    link_mm: Vector
    zero_rad: float
    mass_kg: float | None = Field(default=None, ge=0.0)
    centre_of_mass_mm: Vector | None = None
    coupled_to: str | None = None
    ratio: float | None = None
    encoder: Encoder | None = None


class Probe(StrictModel):
    """The probe; vector and direction are written in the base posture."""

    radius_mm: float = Field(ge=0.0)
    kind: Literal["hard", "switching"] = "hard"
    vector_mm: Vector = (0.0, 0.0, 0.0)
    direction: Vector | None = None
    mass_kg: float | None = Field(default=None, ge=0.0)


class Home(StrictModel):
    """A posture into which the arm can be put by itself, against stops or marks."""

    angles_rad: Mapping[str, float]
    origin: str | None = None


class Reference(StrictModel):
    """Conditions under which the geometry holds."""

    temperature_c: float = 20.0
    gravity_m_s2: Vector = (0.0, 0.0, -9.80665)


Moment = datetime | date | str


class Identification(StrictModel):
    """Provenance and quality of an identified arm; `arm_digest`: `geometry_digest`."""

    sigma0: float | None = Field(default=None, ge=0.0)
    redundancy: int | None = None
    date: Moment | None = None  # no plain `date`: this key would hide the type
    campaign_digest: str | None = None
    temperature_low_c: float | None = None
    temperature_high_c: float | None = None
    design_digest: str | None = None
    parameters: tuple[str, ...] | None = None
    covariance_file: str | None = None
    covariance_digest: str | None = None
    arm_digest: str | None = None


class Effect(StrictModel):
    """A correction beyond the geometry; the keys of each kind are in EFFECT_KINDS."""

    kind: str
    joint: str | None = None
    epoch_utc: AwareDatetime | None = None

    @property
    def values(self) -> Mapping[str, Any]:
        return {key: getattr(self, key) for key in EFFECT_KINDS[self.kind].keys}

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to another process as a table: classes of kinds have no module."""
        return effect_from_table, (self.model_dump(exclude_unset=True),)

    @classmethod
    def variant(cls, table: object) -> "type[Effect]":
        kind = table.get("kind") if isinstance(table, Mapping) else None
        return _effect_model(str(kind)) if str(kind) in EFFECT_KINDS else _UnknownEffect

    @field_validator("kind")
    @classmethod
    def _known_kind(cls, kind: str) -> str:
        if kind not in EFFECT_KINDS:
            raise ValueError(unknown_name_message("kind", kind, EFFECT_KINDS))
        return kind


class _UnknownEffect(Effect):
    """An effect of unknown kind: only the kind is an error, not the other keys."""

    model_config = ConfigDict(extra="ignore")


@cache
def _effect_model(name: str) -> type[Effect]:
    kind = EFFECT_KINDS[name]
    fields: dict[str, Any] = {key: (of, ...) for key, of in kind.keys.items()}
    if kind.joint == "required":
        fields["joint"] = (str, ...)
    if kind.effect_class == "A":
        fields["epoch_utc"] = (AwareDatetime, ...)
    return create_model(name, __base__=Effect, __module__=__name__, **fields)


def effect_from_table(table: object) -> Effect:
    if isinstance(table, Effect):
        return table
    return Effect.variant(table).model_validate(tuples_for_lists(table))


class Arm(StrictModel):
    """An articulated arm, with numbers as in its file."""

    schema_: Literal["traverse/arm/1"] = Field(alias="schema")
    name: str
    serial_number: str | None = None
    origin_mm: Vector
    joints: tuple[Joint, ...]
    probe: Probe
    reference: Reference = Reference()
    home: Home | None = None
    identification: Identification | None = None
    effects: tuple[
        Annotated[SerializeAsAny[Effect], BeforeValidator(effect_from_table)], ...
    ] = ()


def parse_arm(text: str, source: str = "arm file") -> Arm:
    """Parse the text of an arm file.

    Raises:
        FileError: lists all mistakes.
    """
    return parse_strict(text, source, Arm, arm_problems)


def read_arm(path: str | Path) -> Arm:
    """Read an arm file.

    Raises:
        FileError: lists all mistakes.
    """
    return read_strict(path, Arm, arm_problems)


def write_arm(path: str | Path, arm: Arm) -> None:
    """Write an arm file in place of an old one, whole or not at all.

    Comments of the old file and lines with unchanged values stay.

    Raises:
        FileError: the arm breaks a rule of arm files; the old file stays.
        OSError: the folder cannot be written.
    """
    from traverse.strict_toml.rewriting import rewritten_text  # noqa: PLC0415 - not to read one

    values = arm.model_dump(by_alias=True, exclude_unset=True)
    text = rewritten_text(values, _text_before(Path(path)))
    if parse_arm(text, str(path)) != arm:
        raise FileError(path, "would not hold all values of this arm")
    write_atomically(Path(path), text)


def _text_before(path: Path) -> str | None:
    try:
        parse_arm(text := toml_text(path), str(path))
    except FileError:
        return None
    return text


def arm_digest(arm: Arm) -> str:
    """Return a digest of the values (SHA-256, hexadecimal)."""
    values = arm.model_dump(by_alias=True, exclude_none=True)
    return hashlib.sha256(canonical_text(values).encode()).hexdigest()


def geometry_digest(arm: Arm) -> str:
    """Return a digest of all values that an identification answers for.

    Names, provenance, home posture and sources of encoders are not among them.
    """
    left_out: dict[str, Any] = {
        **dict.fromkeys(("name", "serial_number", "home", "identification"), True),
        "joints": {"__all__": {"encoder": {"source": True, "absolute": True}}},
    }
    values = arm.model_dump(by_alias=True, exclude_none=True, exclude=left_out)
    return hashlib.sha256(canonical_text(values).encode()).hexdigest()
