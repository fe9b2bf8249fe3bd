"""The keys of a table of the configuration as fields of a form."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel

SCALARS = ("string", "integer", "number", "boolean")
YES, NO = "yes", "no"
_BOUNDS = (
    ("minimum", "at least"),
    ("exclusiveMinimum", "above"),
    ("maximum", "at most"),
    ("exclusiveMaximum", "below"),
)


@dataclass(frozen=True, slots=True)
class Setting:
    """A key whose value is a line of text in a form.

    Attributes:
        key: Of the table.
        kind: "string", "integer", "number", "boolean" or "array".
        entry_kind: Of the entries of an array; else empty.
        choices: All values that are allowed; empty: any of the kind.
        is_required: It has no default.
        hint: Its default and its bounds.
    """

    key: str
    kind: str
    entry_kind: str
    choices: tuple[str, ...]
    is_required: bool
    hint: str

    def value_of(self, text: str) -> object:
        """Return the value of a text; None for an empty one.

        A text of another kind is returned as it is, for the file's reader to refuse.
        """
        text = text.strip()
        if not text:
            return None
        if self.kind != "array":
            return _scalar(self.kind, text)
        entries = text.removeprefix("[").removesuffix("]").split(",")
        return [_scalar(self.entry_kind, e.strip()) for e in entries if e.strip()]

    def text_of(self, value: object) -> str:
        """Return the text of a value; empty for none."""
        match value:
            case None:
                return ""
            case bool():
                return YES if value else NO
            case list() | tuple():
                return ", ".join(map(self.text_of, value))
            case float():
                return _number_text(value)
            case _:
                return str(value)


def settings_of(model: type[BaseModel]) -> list[Setting]:
    """Return the keys of a table that a line of text can hold, required ones first."""
    schema = model.model_json_schema()
    required = schema.get("required", ())
    settings = [
        setting
        for key, described in schema.get("properties", {}).items()
        if (setting := _setting_of(key, described, is_required=key in required))
    ]
    return sorted(settings, key=lambda setting: not setting.is_required)


def _setting_of(
    key: str, described: Mapping[str, Any], *, is_required: bool
) -> Setting | None:
    """Return a key by its JSON schema; None for tables."""
    branches = described.get("anyOf", (described,))
    kinds = [branch for branch in branches if branch.get("type") != "null"]
    kind, entry = kinds[0].get("type"), kinds[0].get("items") or {"type": "number"}
    is_array = kind == "array" and entry.get("type") in SCALARS
    if len(kinds) > 1 or not (kind in SCALARS or is_array):
        return None
    bare = Setting(
        key,
        kind,
        entry["type"] if is_array else "",
        (YES, NO) if kind == "boolean" else tuple(map(str, kinds[0].get("enum", ()))),
        is_required,
        "",
    )
    default = bare.text_of(described.get("default"))
    hints = [f"default {default}"] if default else []
    hints += [
        f"{words} {_number_text(kinds[0][bound])}"
        for bound, words in _BOUNDS
        if bound in kinds[0]
    ]
    return replace(bare, hint=", ".join(hints))


def _number_text(number: float) -> str:
    return str(int(number)) if float(number).is_integer() else f"{number:g}"


def _scalar(kind: str, text: str) -> object:
    if kind == "boolean":
        return {YES: True, NO: False}.get(text.lower(), text)
    for convert in {"integer": (int,), "number": (int, float)}.get(kind, ()):
        try:
            return convert(text)
        except ValueError:
            continue
    return text
