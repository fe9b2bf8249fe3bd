"""Mistakes of a message."""

import reprlib
from dataclasses import dataclass
from typing import Self

from pydantic import ValidationError

MAX_PROBLEMS = 20
"""Most mistakes reported of one message; a hostile one could have thousands."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake: place, value, expectation."""

    where: str
    what: str
    expected: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}; expected {self.expected}"


class MessageError(ValueError):
    """A payload, array, argument or topic that cannot be accepted.

    Remedy: the sender has to send something else; repeating it does not help.

    Attributes:
        problems: every mistake found, at least one, at most MAX_PROBLEMS.
    """

    def __init__(self, problems: tuple[Problem, ...]) -> None:
        self.problems = problems
        super().__init__("\n".join(map(str, problems)))

    @classmethod
    def of(cls, where: str, problem: str, expected: str) -> Self:
        return cls((Problem(where, problem, expected),))

    @classmethod
    def from_validation(cls, name: str, error: ValidationError) -> Self:
        """Create an error with all mistakes of pydantic, each with its key path."""
        problems = error.errors(include_url=False, include_context=False)
        return cls(
            tuple(
                Problem(
                    ".".join([name, *map(str, problem["loc"])]),
                    _found_value(problem["type"], problem["input"]),
                    _expected(problem["type"], problem["msg"]),
                )
                for problem in problems[:MAX_PROBLEMS]
            )
        )


def _found_value(kind: str, value: object) -> str:
    if kind == "missing":
        return "nothing"
    if kind == "extra_forbidden":
        return "a key that this message does not have"
    return reprlib.repr(value)


def _expected(kind: str, text: str) -> str:
    """Pydantic's sentence as the end of ours."""
    if kind == "missing":
        return "a value"
    if kind == "extra_forbidden":
        return "no such key"
    return text.removeprefix("Value error, ").removeprefix("Input should be ")
