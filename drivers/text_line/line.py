"""Lines of text: split out of bytes, checked as a whole, read or refused.

A pattern is a line as the board prints it, with fields in braces. Text outside the
braces must match exactly, except for more blanks. A line is read only if all of it
fits.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import xor

MAX_LINE = 512  # bytes; the longest of seven joints with names has a third of it
MAX_VALUE = 1e9
FIELDS = {
    "joint": r"[ \t]*([+-]?[0-9]{1,12}(?:\.[0-9]{0,9})?|[xm])",
    "time": r"[ \t]*([0-9]{1,12}(?:\.[0-9]{0,9})?)",
    "seq": r"[ \t]*([0-9]{1,10})",
    "buttons": r"[ \t]*([0-9]{1,3})",
    "button": r"[ \t]*([01])",
    "checksum": r"([0-9A-Fa-f]{2})",
}
WITHOUT_COUNT = {"x": "does not answer", "m": "has no magnet"}
"""What a board prints in place of the count of an encoder that has none."""
SAME_STEP = 1.01  # counts: digits and counts are the same places
SINGLE = ("time", "seq", "buttons", "checksum")
KNOWN = ", ".join(f"{{{name}}}" for name in (*FIELDS, "skip"))


@dataclass(frozen=True, slots=True)
class Line:
    """A valid line.

    Attributes:
        counts: of all joints, from 0 to below counts per turn.
        ticks: its time; None without.
        seq: its number; None without.
    """

    counts: tuple[int, ...]
    ticks: int | None = None
    seq: int | None = None
    buttons: int = 0


@dataclass(frozen=True, slots=True)
class OddLine:
    """A line that cannot be read; ``reason`` is for people."""

    reason: str


class _OddError(Exception):
    """Why a line is odd."""


class LineSplitter:
    """Splits received bytes into lines of at most `MAX_LINE` bytes each.

    Lines end with CR, LF or both. Bytes before the first line end may be the rest of a
    line: they are dropped.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._dropping = True
        self.overlong = 0

    def feed(self, data: bytes) -> list[bytes]:
        """Return complete lines, without their ends and empty ones."""
        lines = []
        *ended, unended = data.replace(b"\r", b"\n").split(b"\n")
        for part in ended:
            self._add(part)
            if self._dropping:
                self._dropping = False
            elif line := bytes(self._buffer):
                lines.append(line)
            self._buffer.clear()
        self._add(unended)
        return lines

    def _add(self, part: bytes) -> None:
        if self._dropping:
            return
        self._buffer += part[: MAX_LINE + 1]
        if len(self._buffer) > MAX_LINE:
            self._buffer.clear()
            self._dropping = True
            self.overlong += 1


class LinePattern:
    """Reads lines of one form.

    Args:
        unit: of the joints: "counts", "deg" or "rad".
        decimals: digits behind the point of angles; None for any number.
        ticks_per_time: ticks in one unit of ``{time}``.
        seq_bits: of ``{seq}``.
        checksum: "none", "xor" or "sum".

    Attributes:
        fields: names in the order of the line.
        digits: most digits behind the point of an angle so far, or `decimals`.

    Raises:
        ValueError: the pattern is invalid, with the reason.
    """

    def __init__(
        self,
        text: str,
        unit: str,
        counts_per_turn: Sequence[int],
        *,
        decimals: int | None = None,
        ticks_per_time: int = 1,
        seq_bits: int = 32,
        checksum: str = "none",
    ) -> None:
        self.fields: list[str] = []
        self._regex = re.compile(self._expression(text.strip()))
        for name in SINGLE:
            if self.fields.count(name) > 1:
                raise ValueError(f"{{{name}}} is in the pattern more than once")
        if "joint" not in self.fields:
            raise ValueError(f"the pattern has no {{joint}}; fields are {KNOWN}")
        if "button" in self.fields and "buttons" in self.fields:
            raise ValueError("the pattern has both {button} and {buttons}; keep one")
        if self.fields.count("button") > 8:
            raise ValueError("the pattern has more than 8 fields {button}")
        self._per_turn = {"counts": 0.0, "deg": 360.0, "rad": math.tau}[unit]
        self._counts_per_turn = tuple(counts_per_turn)
        self._decimals = decimals
        self.digits = decimals or 0
        self._ticks_per_time = ticks_per_time
        self._seq_limit = 1 << seq_bits
        self._checksum = checksum

    @property
    def n_joints(self) -> int:
        return self.fields.count("joint")

    @property
    def n_inputs(self) -> int:
        return 8 if "buttons" in self.fields else self.fields.count("button")

    @property
    def steps_counts(self) -> tuple[float, ...]:
        """By how many counts the printed angles differ at least; empty for counts.

        Rounding to digits adds to that to counts.
        """
        if not self._per_turn:
            return ()
        steps = (
            10.0**-self.digits / self._per_turn * counts
            for counts in self._counts_per_turn
        )
        return tuple(math.hypot(1.0, s) if s > SAME_STEP else 1.0 for s in steps)

    def read(self, raw: bytes) -> Line | OddLine:
        if not raw.isascii():
            return OddLine("has bytes that are no text")
        match = self._regex.fullmatch(raw.decode("ascii").strip(" \t\r"))
        if match is None:
            return OddLine("does not fit the pattern")
        words: dict[str, list[str]] = {name: [] for name in FIELDS}
        for name, word in zip(self.fields, match.groups(), strict=True):
            words[name].append(word)
        try:
            if words["checksum"]:
                self._check_sum(match)
            return Line(
                tuple(self._count(word, k) for k, word in enumerate(words["joint"])),
                self._ticks(words["time"][0]) if words["time"] else None,
                self._bounded(words["seq"][0], self._seq_limit, "number")
                if words["seq"]
                else None,
                self._bounded(words["buttons"][0], 1 << 8, "buttons")
                if words["buttons"]
                else sum(int(word) << k for k, word in enumerate(words["button"])),
            )
        except _OddError as error:
            return OddLine(str(error))

    def _count(self, word: str, joint: int) -> int:
        if word in WITHOUT_COUNT:
            raise _OddError(f"says that joint {joint + 1} {WITHOUT_COUNT[word]}")
        value, modulus = float(word), self._counts_per_turn[joint]
        _, point, digits = word.partition(".")
        is_integer = not self._per_turn
        if abs(value) > MAX_VALUE or (is_integer and point):
            raise _OddError(f"has {word!r} for joint {joint + 1}")
        if is_integer:
            return int(word) % modulus
        if self._decimals is not None and len(digits) != self._decimals:
            raise _OddError(f"has {word!r} for joint {joint + 1}, see decimals")
        self.digits = max(self.digits, len(digits))
        return round(value / self._per_turn * modulus) % modulus

    def _ticks(self, word: str) -> int:
        if self._ticks_per_time == 1 and "." in word:
            raise _OddError(
                f"has the time {word!r}, expected a whole number (time_unit says that "
                "it is in milliseconds or microseconds)"
            )
        return round(float(word) * self._ticks_per_time)

    @staticmethod
    def _bounded(word: str, limit: int, name: str) -> int:
        if (value := int(word)) >= limit:
            raise _OddError(f"has the {name} {value}, expected less than {limit}")
        return value

    def _check_sum(self, match: re.Match[str]) -> None:
        """Check all before the sign in front of the checksum, without a leading "$"."""
        number = self.fields.index("checksum") + 1
        data = match.string[: match.start(number) - 1].removeprefix("$").encode()
        total = sum(data) & 0xFF if self._checksum == "sum" else reduce(xor, data, 0)
        if total != int(match.group(number), 16):
            raise _OddError("has a wrong checksum")

    def _expression(self, text: str) -> str:
        """The regular expression; no two neighbours of it can share a character."""
        if not (text.isascii() and text.isprintable()):
            raise ValueError("the pattern has signs that are not ASCII")
        parts = re.split(r"\{([^{}]*)\}", text)
        expression = ""
        for number, part in enumerate(parts):
            if number % 2 == 0:
                if "{" in part or "}" in part:
                    raise ValueError(f"the pattern has a single brace near {part!r}")
                if not part and 0 < number < len(parts) - 1:
                    raise ValueError("the pattern has two fields without a separator")
                pieces = re.split(r"[ \t]+", part)
                expression += r"[ \t]+".join(re.escape(piece) for piece in pieces)
            elif part == "skip":
                after = parts[number + 1][:1]
                expression += f"[^{re.escape(after)}]*" if after else ".*"
            elif part in FIELDS:
                self.fields.append(part)
                expression += FIELDS[part]
            else:
                raise ValueError(f"no field {{{part}}}; fields are {KNOWN}")
        return expression
