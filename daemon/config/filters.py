"""The `[[scan.filters]]` tables.

Their keys are those of the filter classes, so that each is defined once.
"""

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields
from functools import cache
from typing import Annotated, Any, Self, get_type_hints

from pydantic import (
    BeforeValidator,
    ConfigDict,
    SerializeAsAny,
    create_model,
    field_validator,
    model_validator,
)

from traverse.kinematics.filters import FILTERS, FilterChain, PointFilter
from traverse.protocol.messages import QualityFlag
from traverse.strict_toml.problems import unknown_name_message
from traverse.strict_toml.reader import StrictModel

FLAGS = {flag.name.lower(): flag for flag in QualityFlag if flag.name}
"""Quality flags by their names in files and messages."""


def flag_bits(names: Iterable[str]) -> int:
    """Combine flags by name.

    Raises:
        ValueError: a name is unknown.
    """
    bits = 0
    for name in names:
        if name not in FLAGS:
            raise ValueError(unknown_name_message("quality flag", name, FLAGS))
        bits |= FLAGS[name].value
    return bits


class FilterSection(StrictModel):
    """A filter; subclasses add the keys of its kind."""

    kind: str

    @classmethod
    def variant(cls, table: object) -> "type[FilterSection]":
        """Select the class of a table by its kind."""
        name = table.get("kind") if isinstance(table, Mapping) else None
        return section_class(str(name))

    def create(self) -> PointFilter:
        """Create the filter.

        Raises:
            ValueError: its keys are inconsistent.
        """
        values = {name: value for name, value in self if name != "kind"}
        return FILTERS[self.kind](**values)

    @model_validator(mode="after")
    def _check_create(self) -> Self:
        self.create()
        return self


class UnknownFilterSection(FilterSection):
    """Table of an unknown kind; refused for that alone, not for its other keys."""

    model_config = ConfigDict(extra="ignore")

    @field_validator("kind")
    @classmethod
    def _refuse(cls, name: str) -> str:
        raise ValueError(unknown_name_message("filter", name, FILTERS))


class QualityFilterSection(FilterSection):
    """Table of the quality filter: flags by name become bits."""

    allowed: tuple[str, ...] = ()

    def create(self) -> PointFilter:
        return FILTERS[self.kind](**{"allowed": flag_bits(self.allowed)})


@cache
def section_class(kind: str) -> type[FilterSection]:
    made = FILTERS.get(kind)
    if made is None:
        return UnknownFilterSection
    if kind == "quality":
        return QualityFilterSection
    hints = get_type_hints(made)
    keys: dict[str, Any] = {
        field.name: (
            hints[field.name],
            ... if field.default is MISSING else field.default,
        )
        for field in fields(made)  # type: ignore[arg-type]  # every filter is a dataclass
        if field.init
    }
    return create_model(f"{made.__name__}Section", __base__=FilterSection, **keys)


AnyFilter = Annotated[
    SerializeAsAny[FilterSection], BeforeValidator(FilterSection.from_table)
]


def filter_chain(sections: Iterable[FilterSection]) -> FilterChain:
    return FilterChain([section.create() for section in sections])


def removed_counters(chain: FilterChain) -> dict[str, int]:
    """Return how many points each filter has removed, by position and kind."""
    return {
        f"scan_filter_{place}_{filter_.kind}": removed
        for place, (filter_, removed) in enumerate(
            zip(chain.filters, chain.removed, strict=True), start=1
        )
        if not filter_.interpolates
    }
