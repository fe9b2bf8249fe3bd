"""Mistakes of a file with their places: all at once, in our words.

Rules of this file: no pydantic here; validation errors arrive as plain mappings
(type, loc, msg, input, ctx) and leave as `Problem` values.
"""

import difflib
import errno
import math
import re
import tomllib
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from traverse.plurals import counted
from traverse.strict_toml.files import MOST_TOML_BYTES, bytes_of
from traverse.strict_toml.ownership import reason_of_owner

_SHOWN_LENGTH = 60
MOST_SHOWN = 100  # problems of a file
DEEPEST = 32
LARGEST = 1e20
_SYNTAX_PLACE = re.compile(r" \(at (line \d+, column \d+|end of document)\)$")

_REMEDIES = {
    errno.EISDIR: "expected a file",
    errno.ENOTDIR: "expected a folder",
    errno.EEXIST: "expected a folder",
    **dict.fromkeys(
        (errno.EACCES, errno.EPERM, errno.EROFS),
        "correct its rights, or name another place",
    ),
    errno.ENOSPC: "make room on that disk",
    errno.EINVAL: "expected a file",
    errno.EFBIG: "expected another file",
    errno.EBUSY: "end that program, or name another place",
}

_WORDING: Mapping[str, str] = {
    "float_type": "{value} is not a number",
    "finite_number": "{value} is not a finite number",
    "int_type": "{value} is not an integer",
    "int_from_float": "{value} is not an integer",
    "float_parsing": "{value} is not a number; expected one, without its unit",
    "int_parsing": "{value} is not an integer; expected one, without its unit",
    "string_type": "{value} is not a string; put it in quotes",
    "bool_type": "{value} is not true or false",
    "tuple_type": "{value} is not a list",
    "model_type": "{value} is not a table of keys",
    "model_attributes_type": "{value} is not a table of keys",
    "dict_type": "{value} is not a table of keys",
    "datetime_type": "{value} is not a date and time such as 2026-11-20T09:00:00Z",
    "timezone_aware": "{value} has no offset from UTC; end it with Z",
    "literal_error": "{value} is not valid here; expected {expected}",
    "greater_than": "{value} is too small; it must be greater than {gt}",
    "greater_than_equal": "{value} is too small; it must be at least {ge}",
    "less_than": "{value} is too large; it must be less than {lt}",
    "less_than_equal": "{value} is too large; it must be at most {le}",
    "string_too_short": "{value} is too short",
    "string_pattern_mismatch": "{value} does not have the form {pattern}",
    "too_short": "has {entries}; expected at least {min_length}",
    "too_long": "has {entries}; expected at most {max_length}",
    "missing": "is missing; add it",
}


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake.

    Attributes:
        where: Key path such as `joints[2].axis`, list indices from 0 in the order
            of the file; a line and column for syntax; empty for the whole file.
        message: The value there, and the expectation.
    """

    where: str
    message: str

    def __str__(self) -> str:
        return f"{self.where}: {self.message}" if self.where else self.message


class FileError(ValueError):
    """A file was refused; edit it. Carries all that is wrong with it.

    A text in place of a problem is one of the whole file.
    """

    def __init__(
        self, source: str | Path, problems: Iterable[Problem | str] | str
    ) -> None:
        self.source = str(source)
        entries = [problems] if isinstance(problems, str) else problems
        self.problems = tuple(
            Problem("", each) if isinstance(each, str) else each for each in entries
        )
        super().__init__(self.source, self.problems)

    def __str__(self) -> str:
        head = f"{self.source}: {counted(len(self.problems), 'problem')}"
        return "\n".join([head, *(f"  {text}" for text in self._shown())])

    @property
    def line(self) -> str:
        """The same on one line, for messages and logs."""
        return f"{self.source}: {'; '.join(self._shown())}"

    def _shown(self) -> list[str]:
        texts = [str(problem) for problem in self.problems[:MOST_SHOWN]]
        n_more = len(self.problems) - len(texts)
        return [*texts, f"and {n_more} more"] if n_more else texts


def key_path(location: Iterable[str | int]) -> str:
    """Write ('joints', 2, 'axis') as 'joints[2].axis'."""
    parts: list[str] = []
    for step in location:
        if isinstance(step, int):
            parts.append(f"[{step}]")
        else:
            parts.append(f".{step}" if parts else step)
    return "".join(parts)


def shown(value: object) -> str:
    """Say a value as found in a file, shortened."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= _SHOWN_LENGTH else text[: _SHOWN_LENGTH - 3] + "..."


def character_name(character: str) -> str:
    """Name a character as Unicode does: U+2212 MINUS SIGN."""
    name = unicodedata.name(character, "control character")
    return f"U+{ord(character):04X} {name}"


def odd_characters(text: str) -> str:
    """Name the characters of a number that are no plain ones; empty without any."""
    odd = dict.fromkeys(
        character
        for character in text
        if not (character.isascii() and character.isprintable())
    )
    return ", ".join(map(character_name, odd))


def system_reason(error: OSError) -> str:
    """Return why the system did not read or write a file, and the remedy."""
    if owner := reason_of_owner(error):
        return f"{error.strerror}: {owner}"
    remedy = _REMEDIES.get(error.errno or 0, "check the path")
    return f"{error.strerror or error}; {remedy}"


def reason_of(error: BaseException) -> str:
    """Return why a file could not be read or written, for people."""
    if isinstance(error, OSError):
        return system_reason(error)
    return str(error) or type(error).__name__


def unknown_name_message(kind: str, name: str, known: Collection[str]) -> str:
    """Refuse a name, of a key for example, and say the nearest one that exists."""
    with_unit = [entry for entry in known if entry.startswith(f"{name}_")]
    if with_unit and kind == "key":
        return (
            f"unknown key '{name}'; did you mean '{min(with_unit, key=len)}'? "
            "units are part of the name"
        )
    by_lower_case = {entry.lower(): entry for entry in sorted(known)}
    nearest = difflib.get_close_matches(name.lower(), by_lower_case, n=1)
    if nearest:
        suggestion = by_lower_case[nearest[0]]
        return f"unknown {kind} '{name}'; did you mean '{suggestion}'?"
    return f"unknown {kind} '{name}'; known here: {', '.join(sorted(known))}"


# Units of other people's files: to which, by what factor.
_CONVERSIONS = {
    "deg": ("rad", math.pi / 180.0),
    "m": ("mm", 1000.0),
    "cm": ("mm", 10.0),
    "um": ("mm", 1e-3),
    "inch": ("mm", 25.4),
    "ms": ("s", 1e-3),
    "g": ("kg", 1e-3),
}


def _converted(name: str, value: object, known: Collection[str]) -> str | None:
    """Refuse a key in another unit with the key in ours, and its value."""
    stem, _, unit = name.rpartition("_")
    ours, factor = _CONVERSIONS.get(unit, ("", 0.0))
    key = f"{stem}_{ours}"
    if not ours or key not in known:
        return None
    values = value if isinstance(value, list | tuple) else [value]
    numbers = [number_in(value) for value in values]
    texts = [f"{factor * number:.12g}" for number in numbers if number is not None]
    if len(texts) < len(numbers):
        return f"unknown key '{name}'; expected '{key}'"
    text = texts[0] if values is not value else f"[{', '.join(texts)}]"
    return f"unknown key '{name}'; expected {key} = {text}"


def problem_from_error(error: Mapping[str, Any], known: Collection[str]) -> Problem:
    """Put a validation error (type, loc, msg, input, perhaps ctx) into our words.

    ``known`` are the valid keys of the table with the error.
    """
    location: tuple[str | int, ...] = error["loc"]
    kind: str = error["type"]
    if kind == "extra_forbidden":
        name = str(location[-1])
        message = _converted(name, error["input"], known) or unknown_name_message(
            "key", name, known
        )
    elif kind == "missing" and isinstance(location[-1], int):
        length = len(error["input"])
        location = location[:-1]
        message = f"has {counted(length, 'entry')}, which is too few"
    elif kind == "value_error":
        message = str(error["ctx"]["error"])
    elif kind in _WORDING:
        shown_value = shown(error["input"])
        context = error.get("ctx", {})
        entries = counted(context.get("actual_length", 0), "entry")
        message = _WORDING[kind].format(value=shown_value, entries=entries, **context)
        if kind == "too_long" and all(type(value) is int for value in error["input"]):
            message += "; a decimal comma separates entries: write 250.0, not 250,0"
    else:
        message = f"{shown(error['input'])}: {error['msg']}"
    return Problem(key_path(location), message)


def in_file_order(problems: Iterable[Problem], raw: Mapping[str, Any]) -> list[Problem]:
    """Sort problems by the table they are in, as the file has them."""
    places = {name: number for number, name in enumerate(raw)}

    def place(problem: Problem) -> tuple[int, list[tuple[int, str]]]:
        steps = re.findall(r"[^.\[\]]+", problem.where)
        table = places.get(steps[0], len(places)) if steps else len(places)
        return table, [(int(s), "") if s.isdigit() else (-1, s) for s in steps[:2]]

    return sorted(problems, key=place)


def toml_text(path: Path) -> str:
    """Read a file as UTF-8 text.

    Raises:
        FileError: It cannot be read, or is not UTF-8.
    """
    try:
        content = bytes_of(path, MOST_TOML_BYTES)
    except OSError as error:
        raise FileError(path, f"cannot be read: {system_reason(error)}") from error
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        before = content[: error.start]
        line = before.count(b"\n") + 1
        column = len(before) - (before.rfind(b"\n") + 1) + 1
        where = f"line {line}, column {column}"
        problem = (
            f"byte 0x{content[error.start]:02x} is not UTF-8; save the file as UTF-8"
        )
        raise FileError(path, [Problem(where, problem)]) from error


def toml_table(text: str, source: str) -> dict[str, Any]:
    """Parse TOML text into plain values.

    Raises:
        FileError: The text is not TOML; says the line and column.
    """
    try:
        raw = tomllib.loads(text)
        if _depth(raw) > DEEPEST:
            raise RecursionError
        return raw
    except RecursionError as error:
        raise FileError(source, f"is nested more than {DEEPEST} deep") from error
    except ValueError as error:
        message = str(error)
        place = _SYNTAX_PLACE.search(message)
        where = place.group(1) if place else ""
        if where == "end of document":
            lines = text.split("\n")
            where = f"line {len(lines)}, column {len(lines[-1]) + 1}"
        problem = _SYNTAX_PLACE.sub("", message).partition("; use sys.")[0]
        if numbers := re.findall(r"\d+", where):
            line_number, column = map(int, numbers)
            line = text.split("\n")[line_number - 1]
            if re.search(r"=\s*[+-]?\d+,\d+\s*(#.*)?$", line):
                problem += "; a decimal comma: write a decimal point"
            elif odd := odd_characters(line[column - 1 : column]):
                problem += f"; {odd} is there"
                if odd.startswith(("U+FEFF", "U+0000")):
                    problem += ": save the file as UTF-8 without a byte order mark"
        raise FileError(source, [Problem(where, f"not TOML: {problem}")]) from error


def _depth(value: object) -> int:
    pending, deepest = [(value, 0)], 0
    while pending:
        value, depth = pending.pop()
        deepest = max(deepest, depth)
        if isinstance(value, Mapping | list):
            inner = value.values() if isinstance(value, Mapping) else value
            pending.extend((entry, depth + 1) for entry in inner)
    return deepest


def value_problems(
    value: object, location: tuple[str | int, ...] = ()
) -> Iterator[Problem]:
    """Yield values that no file needs: absurdly large numbers, texts with NUL."""
    if isinstance(value, Mapping | list):
        steps = value.items() if isinstance(value, Mapping) else enumerate(value)
        for step, entry in steps:
            yield from value_problems(entry, (*location, step))
    elif isinstance(value, str) and "\0" in value:
        yield Problem(key_path(location), f"{shown(value)} has a NUL character")
    elif isinstance(value, int | float) and LARGEST < abs(value) < math.inf:
        yield Problem(key_path(location), out_of_range(value))


def out_of_range(value: float | str) -> str:
    """Refuse a number whose powers could not be computed with."""
    return f"{shown(value)} is out of range; expected at most {LARGEST:g} either way"


def is_number(value: float) -> bool:
    """Whether a number is finite, and its powers can be computed with."""
    return abs(value) <= LARGEST


def tables_in(value: object) -> list[Mapping[str, Any]]:
    """Take a list of tables; other values count as empty tables."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        return []
    return [entry if isinstance(entry, Mapping) else {} for entry in value]


def number_in(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if is_number(number) else None


def numbers_in(value: object) -> tuple[float, ...] | None:
    if not isinstance(value, Sequence) or isinstance(value, str):
        return None
    numbers = tuple(number_in(entry) for entry in value)
    kept = tuple(number for number in numbers if number is not None)
    return kept if len(kept) == len(numbers) else None


def vector_in(value: object) -> tuple[float, ...] | None:
    """Take a list of three finite numbers, or nothing."""
    numbers = numbers_in(value)
    return numbers if numbers is not None and len(numbers) == 3 else None
