"""Tables of a configuration whose `kind` determines their other keys."""

from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar, Self, TypeVar

from pydantic import ConfigDict, create_model, field_validator

from traverse.strict_toml.reader import StrictModel

T = TypeVar("T", bound="KindTable")


class KindTable(StrictModel):
    """Base of a family of tables; every kind is a child of the family's class.

    Attributes:
        FAMILY: name of the family, for messages.
        KINDS: by kind, the input of `class_of`.
    """

    FAMILY: ClassVar[str]
    KINDS: ClassVar[dict[str, Any]]

    kind: str

    @classmethod
    def class_of(cls, kind: str) -> type[Self]:
        table_class: type[Self] = cls.KINDS[kind]
        return table_class

    @classmethod
    def variant(cls, table: object) -> type[Self]:
        default = cls.model_fields["kind"].default
        kind = table.get("kind", default) if isinstance(table, Mapping) else None
        return cls.class_of(str(kind)) if str(kind) in cls.KINDS else _unknown(cls)


class _UnknownKind(KindTable):
    """A table of unknown kind: only the kind is an error, not the other keys."""

    model_config = ConfigDict(extra="ignore")

    @field_validator("kind")
    @classmethod
    def _refuse(cls, kind: str) -> str:
        known = ", ".join(sorted(cls.KINDS))
        raise ValueError(f"unknown kind of {cls.FAMILY} '{kind}'; known: {known}")


@cache
def _unknown(family: type[T]) -> type[T]:
    if issubclass(family, _UnknownKind):
        return family
    bases: tuple[type[Any], ...] = (family, _UnknownKind)
    return create_model(f"Unknown{family.__name__}", __base__=bases)
