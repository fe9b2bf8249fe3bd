"""Validation errors of a model as problems of the file that was validated.

Rules of this file: model classes are met only through `model_fields` and `variant`,
so that the library behind them stays in `arm_file`.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Protocol, get_args

from traverse.strict_toml.problems import Problem, problem_from_error


class FieldOfModel(Protocol):
    """What a model says about one key."""

    alias: str | None
    annotation: Any


def model_problems(
    model: object,
    raw: Mapping[str, Any],
    errors: Iterable[Mapping[str, Any]],
    reported: Iterable[Problem],
) -> Iterator[Problem]:
    """Yield one problem a key.

    Args:
        model: Class of the whole file.
        raw: Parsed values of the whole file.
        errors: What validation found: mappings of type, loc, msg, input and ctx.
        reported: Problems that are known already; their keys are left out.
    """
    keys = {problem.where for problem in reported}
    for error in errors:
        location = _location_in_file(error["loc"], raw)
        if error["type"] == "too_short" and not _is_short(raw, location, error["ctx"]):
            continue  # it is long enough; its entries are wrong, which is told
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

    Args:
        model: Class of the whole file.
        raw: Parsed values of the whole file.
        location: Of the table.
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


def _fields_by_key(model: object) -> dict[str, FieldOfModel]:
    fields: Mapping[str, FieldOfModel] = getattr(model, "model_fields", {})
    return {field.alias or name: field for name, field in fields.items()}


def _model_of_key(model: object, key: str) -> object:
    """Find the class of the tables under a key, through lists and options."""
    field = _fields_by_key(model).get(key)
    pending = [field.annotation] if field else []
    while pending:
        candidate = pending.pop()
        if hasattr(candidate, "model_fields"):
            return candidate
        pending.extend(get_args(candidate))
    return None
