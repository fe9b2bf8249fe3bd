"""Lines of I++ DME 1.4.3: commands out of bytes, answers into bytes. No state.

Section 6.1 of the specification has the characters and the syntax, section 8.2 the
errors. Every pattern is possessive: reading a line takes time in proportion to it.
"""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import isfinite
from typing import TypeVar

T = TypeVar("T")
MAX_LINE = 65_536
MAX_DIGITS = 16
SERVER_TAG = "E0000"

ERRORS = {
    0: (2, "Buffer full"),
    1: (2, "Illegal tag"),
    2: (2, "No space at pos. 6"),
    6: (2, "Transaction aborted (Use ClearAllErrors To Continue)"),
    7: (3, "Illegal character"),
    8: (3, "Protocol error"),
    500: (3, "Emergency stop"),
    501: (3, "Unsupported command"),
    502: (3, "Incorrect arguments"),
    503: (3, "Controller communications failure"),
    504: (1, "Argument out of range"),
    505: (3, "Argument not recognized"),
    506: (3, "Argument not supported"),
    507: (3, "Illegal command"),
    508: (3, "Bad context"),
    509: (3, "Bad argument"),
    510: (3, "Bad property"),
    511: (3, "Error processing method"),
    512: (1, "No daemons are active"),
    513: (2, "Daemon does not exist"),
    514: (2, "Use ClearAllErrors to continue"),
    515: (2, "Daemon already exists"),
    1000: (3, "Machine in error state"),
    1001: (2, "Illegal touch"),
    1006: (2, "Surface not found"),
    1007: (3, "Theta out of range"),
    1010: (2, "Vector has no norm"),
    1011: (2, "Unable to move"),
    1501: (3, "Probe not armed"),
    1502: (3, "Tool not found"),
    1503: (3, "Tool not defined"),
    2002: (3, "Type of probe does not allow this operation"),
}
"""Severity and text by number. The severity of 0000 is above the default 0, since the
command is not carried out, and that of 0503 below 9: an arm comes back."""


class IppError(Exception):
    """A command is answered with an error.

    Args:
        why: for people, sent by `GetXtdErrStatus`.
        severity: other than the number's own.

    Attributes:
        tag: of the refused line, as far as readable.
    """

    tag = SERVER_TAG

    def __init__(self, number: int, why: str = "", severity: int | None = None) -> None:
        self.number, self.text = number, ERRORS[number][1]
        self.why = why
        self.severity = ERRORS[number][0] if severity is None else severity
        super().__init__(f"{number:04d} {self.text}" + (f": {why}" if why else ""))


@dataclass(frozen=True, slots=True)
class Word:
    """A name without quotes and parentheses, such as `PartCsy` or `E0553`."""

    name: str


@dataclass(frozen=True, slots=True)
class Property:
    """`Name(numbers)`, such as `X()` or `Tool.PtMeasPar.Speed(100)`."""

    name: str
    values: tuple[float, ...] = ()


Argument = str | float | Word | Property
"""A text in quotes, a number, a word, or a property."""


@dataclass(frozen=True, slots=True)
class Command:
    """A line of the client."""

    tag: str
    name: str
    args: tuple[Argument, ...] = ()

    @property
    def is_fast(self) -> bool:
        return self.tag.startswith("E")


_TAG = re.compile(rb"(?!E0000|00000)[E0-9][0-9]{4}")
_NAME = r"[A-Za-z][A-Za-z0-9]*+"
_METHOD = re.compile(rf"({_NAME}) *+\( *+")
_OPEN = re.compile(r" *+\( *+")
_COMMA = re.compile(r" *+, *+")
_CLOSE = re.compile(r" *+\)")
_NUMBER = re.compile(
    r"[+-]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:[Ee][+-]?[0-9]{1,3})?"
)
_TEXT = re.compile(r'"([^"]++)"')
_WORD = re.compile(rf"{_NAME}(?:\.{_NAME})*+")


class LineBuffer:
    """Cuts bytes into lines."""

    def __init__(self) -> None:
        self._rest = b""

    def lines(self, data: bytes) -> Iterable[bytes]:
        """Yield whole lines with their ends, and one that is already too long."""
        *complete_lines, self._rest = (self._rest + data).split(b"\n")
        yield from (line + b"\n" for line in complete_lines)
        if len(self._rest) > MAX_LINE + 2:
            yield self._rest


def parse(line: bytes) -> Command:
    match = _TAG.match(line)
    try:
        if len(line) > MAX_LINE + 2:
            raise IppError(8, f"a line has at most {MAX_LINE} characters", 9)
        text = line.removesuffix(b"\r\n")
        if len(text) == len(line) or not all(32 <= byte <= 126 for byte in text):
            raise IppError(7, "characters are 32 to 126, a line ends in CR LF")
        if match is None:
            raise IppError(1, "00001 to 99999, or E0001 to E9999")
        if text[5:6] != b" ":
            raise IppError(2)
        return _command(match[0].decode(), text[6:].decode())
    except IppError as error:
        if match is not None:
            error.tag = match[0].decode()
        raise


def _command(tag: str, text: str) -> Command:
    head = _METHOD.match(text)
    if head is None:
        raise IppError(8, "expected Method(arguments)")
    args, end = _list(text, head.end(), _argument)
    if end != len(text):
        raise IppError(8, f"nothing may follow column {end + 6}")
    return Command(tag, head[1], args)


def _argument(text: str, place: int) -> tuple[Argument, int]:
    if (match := _TEXT.match(text, place)) is not None:
        return match[1], match.end()
    if (match := _WORD.match(text, place)) is None:
        return _number(text, place)
    name = match[0]
    if (opened := _OPEN.match(text, match.end())) is None:
        if "." in name:
            raise IppError(8, f"{name} has no parentheses")
        return Word(name), match.end()
    values, end = _list(text, opened.end(), _number)
    return Property(name, values), end


def _list(
    text: str, place: int, read: Callable[[str, int], tuple[T, int]]
) -> tuple[tuple[T, ...], int]:
    """Parse the arguments between parentheses; return also the place after them."""
    items: list[T] = []
    end = _CLOSE.match(text, place)
    while end is None:
        item, place = read(text, place)
        items.append(item)
        if (comma := _COMMA.match(text, place)) is not None:
            place = comma.end()
        elif (end := _CLOSE.match(text, place)) is None:
            raise IppError(8, f"expected a comma or ) at column {place + 7}")
    return tuple(items), end.end()


def _number(text: str, place: int) -> tuple[float, int]:
    match = _NUMBER.match(text, place)
    if match is None:
        raise IppError(8, f"expected an argument at column {place + 7}")
    if sum(map(str.isdigit, match[0])) > MAX_DIGITS:
        raise IppError(8, f"a number has at most {MAX_DIGITS} match")
    value = float(match[0])
    if not isfinite(value):
        raise IppError(509, f"{match[0]} is too large")
    return value, match.end()


def number(value: float) -> str:
    """Write a number: six decimals, or with an exponent from 10^9 on."""
    if abs(value) >= 1e9:
        return f"{value:.9e}"
    text = f"{value:.6f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def property_text(name: str, *values: float | str) -> str:
    shown = (quoted(v) if isinstance(v, str) else number(v) for v in values)
    return f"{name}({','.join(shown)})"


def quoted(text: str) -> str:
    """Write a text; unsupported characters become `?`."""
    kept = "".join(c if " " <= c <= "~" and c != '"' else "?" for c in text[:1000])
    return f'"{kept or " "}"'


def error_line(tag: str, method: str, error: IppError) -> str:
    cause, text = quoted(method), quoted(error.text)
    return f"{tag} ! Error({error.severity},{error.number:04d},{cause},{text})"
