"""Strict reading: a TOML file as a frozen model, with every mistake of it at once.

The only module of the package that uses pydantic; validation errors leave it as
`Problem` values.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Self, TypeVar, cast, get_args

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo

from traverse.strict_toml.problems import (
    FileError,
    Problem,
    in_file_order,
    problem_from_error,
    toml_table,
    toml_text,
    value_problems,
)

Model = TypeVar("Model", bound=BaseModel)
CrossCheck = Callable[[Mapping[str, Any]], Iterable[Problem]]


class StrictModel(BaseModel):
    """A frozen table of a file: no unknown keys, no conversions, no NaN.

    Integers are taken for floats; lists of a file become tuples.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        defer_build=True,  # many tables are only read as parts of a file
    )

    @classmethod
    def variant(cls, table: object) -> type["StrictModel"]:
        """Return which class a table belongs to; a child with kinds overrides it."""
        return cls

    @classmethod
    def from_table(cls, table: object) -> Self:
        """Validate a table by its `variant`; an instance is passed on.

        Raises:
            pydantic.ValidationError: with everything that is wrong with it.
        """
        if isinstance(table, cls):
            return table
        return cast("Self", cls.variant(table).model_validate(table))


def read_strict(
    path: str | Path, model: type[Model], cross_check: CrossCheck | None = None
) -> Model:
    """Read a TOML file into a model; see `parse_strict`."""
    return parse_strict(toml_text(Path(path)), str(path), model, cross_check)


def parse_strict(
    text: str, source: str, model: type[Model], cross_check: CrossCheck | None = None
) -> Model:
    """Parse TOML text into a model and report all mistakes at once.

    Args:
        text: TOML.
        source: The file's name in errors.
        model: Usually a child of `StrictModel`. Lists arrive as tuples.
        cross_check: Yields faults between keys, from the raw table, whether or
            not single keys are wrong; its word precedes ours on the same key.

    Raises:
        FileError: With everything that is wrong.
    """
    raw = toml_table(text, source)
    problems = list(value_problems(raw))
    if cross_check and not problems:  # which computes with the numbers
        problems = list(cross_check(raw))
    try:
        value = model.model_validate(tuples_for_lists(raw))
    except ValidationError as error:
        errors = error.errors(include_url=False)
        expected = next((e["ctx"]["expected"] for e in errors if _is_schema(e)), None)
        found_schema = str(raw.get("schema"))
        kind = found_schema.rpartition("/")[0]
        if expected and kind.startswith("traverse/") and f"{kind}/" not in expected:
            # Whatever else is in it belongs to that other kind.
            mismatch = f"this is a file {found_schema!r}; expected {expected}"
            raise FileError(source, [Problem("schema", mismatch)]) from error
        problems = [*problems, *_model_problems(model, raw, errors, problems)]
        raise FileError(source, in_file_order(problems, raw)) from error
    if problems:
        raise FileError(source, in_file_order(problems, raw))
    return value


def _is_schema(error: Mapping[str, Any]) -> bool:
    return (error["loc"], error["type"]) == (("schema",), "literal_error")


def _model_problems(
    model: type[BaseModel],
    raw: Mapping[str, Any],
    errors: Iterable[Mapping[str, Any]],
    reported: Iterable[Problem],
) -> Iterator[Problem]:
    """Yield one problem a key, but for keys with a reported one."""
    keys = {problem.where for problem in reported}
    for error in errors:
        location = _location_in_file(error["loc"], raw)
        if error["type"] == "too_short" and not _is_short(raw, location, error["ctx"]):
            continue  # it is long enough; its entries are wrong, which is reported
        known = _known_keys(model, raw, location[:-1])
        problem = problem_from_error({**error, "loc": location}, known)
        if problem.where not in keys:
            keys.add(problem.where)
            yield problem


def tuples_for_lists(value: object) -> object:
    """Freeze parsed values: lists become tuples, at any depth."""
    if isinstance(value, Mapping):
        return {key: tuples_for_lists(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return tuple(tuples_for_lists(entry) for entry in value)
    return value


def _location_in_file(
    location: tuple[str | int, ...], raw: object
) -> tuple[str | int, ...]:
    """Cut off the steps that name a member of a union, not a key."""
    for depth, step in enumerate(location):
        if isinstance(raw, Mapping) and isinstance(step, str):
            raw = raw.get(step)
        elif isinstance(raw, list) and isinstance(step, int):
            raw = raw[step] if step < len(raw) else None
        else:
            return location[:depth]
    return location


def _is_short(
    raw: Mapping[str, Any], location: tuple[str | int, ...], limits: Mapping[str, Any]
) -> bool:
    """Whether the list at a place of the file has too few entries."""
    value: Any = raw
    for step in location:
        value = value[step]
    return not isinstance(value, list) or len(value) < limits["min_length"]


def _known_keys(
    model: object, raw: object, location: tuple[str | int, ...]
) -> frozenset[str]:
    """List the keys that exist in the table at a place of the file.

    In an annotation of the file's class any class with `model_fields` and `variant` may
    say where the keys of a kind are.
    """
    for step in location:
        if isinstance(raw, Mapping) and isinstance(step, str):
            raw = raw[step]
            model = _model_of_key(model, step)
        elif isinstance(raw, list) and isinstance(step, int):
            raw = raw[step]
        variant = getattr(model, "variant", None)
        if variant is not None:
            model = variant(raw)
    return frozenset(_fields_by_key(model))


def _fields_by_key(model: object) -> dict[str, FieldInfo]:
    fields: Mapping[str, FieldInfo] = getattr(model, "model_fields", {})
    return {field.alias or name: field for name, field in fields.items()}


def _model_of_key(model: object, key: str) -> object:
    """Find the class of the tables under a key, through lists and options."""
    field = _fields_by_key(model).get(key)
    pending: list[Any] = [field.annotation] if field else []
    while pending:
        candidate = pending.pop()
        if hasattr(candidate, "model_fields"):
            return candidate
        pending.extend(get_args(candidate))
    return None
