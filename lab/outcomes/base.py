"""State of a result, its reasons, and the table of conditions that gives both.

Strategy: a result is good only if every condition of its table is established. A check
that returns nothing, or an empty list, has established nothing, so that a condition
which nobody looked at ends in doubt instead of in an all-clear. Command line, JSON,
page and exit status print what comes from here, and judge nothing themselves.

>>> @dataclass(frozen=True)
... class Fit:
...     rms_mm: float
>>> def explains(fit: Fit) -> Established | list[Shortfall]:
...     values = {"rms_mm": fit.rms_mm, "permissible_mm": 0.1}
...     if fit.rms_mm < 0.1:
...         return Established(values)
...     return [Shortfall("0.1 mm are exceeded", "measure again", values, State.BAD)]
>>> table = (Condition("fit", "the model explains the measurements", explains),)
>>> judge(table, Fit(rms_mm=0.02)).state
<State.GOOD: 'good'>
>>> judge(table, Fit(rms_mm=7.0)).reasons[0].text
'0.1 mm are exceeded'
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Generic, TypeVar

Evidence = TypeVar("Evidence")


class State(StrEnum):
    """How far a result may be relied on."""

    GOOD = "good"
    DOUBT = "doubt"
    BAD = "bad"


_ORDER = (State.GOOD, State.DOUBT, State.BAD)


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a result is not good.

    Attributes:
        code: Name of the condition that is not established, in snake case.
        state: The best state that the result can have with it.
        text: What was observed, a sentence.
        remedy: What to do, a sentence in the imperative.
        values: Figures by names that end in their unit, such as `rms_mm`.
    """

    code: str
    state: State
    text: str
    remedy: str
    values: Mapping[str, Any]

    @property
    def sentence(self) -> str:
        """Text and remedy, as reports print them."""
        return f"{self.text} {self.remedy}".strip()


@dataclass(frozen=True, slots=True)
class Outcome:
    """State of a result: the worst of its reasons'.

    Attributes:
        established: Figures of the conditions that hold, by their codes.
    """

    state: State
    reasons: tuple[Reason, ...]
    established: Mapping[str, Mapping[str, Any]]

    @property
    def codes(self) -> tuple[str, ...]:
        """Codes of the reasons, each once, in the order of the table."""
        return tuple(dict.fromkeys(reason.code for reason in self.reasons))

    @property
    def sentences(self) -> list[str]:
        """What was observed and what to do, the worst first."""
        worst_first = sorted(self.reasons, key=lambda entry: -_ORDER.index(entry.state))
        return [reason.sentence for reason in worst_first]


@dataclass(frozen=True, slots=True)
class Established:
    """A condition holds; the figures show how far."""

    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Shortfall:
    """A condition does not hold, or cannot be established.

    Attributes:
        text: What was observed, a sentence.
        remedy: What to do, a sentence in the imperative.
        values: Figures by names that end in their unit.
        state: What it makes of the result.
    """

    text: str
    remedy: str
    values: Mapping[str, Any] = field(default_factory=dict)
    state: State = State.DOUBT


Finding = Established | Sequence[Shortfall]


def doubt(
    text: str, remedy: str, values: Mapping[str, Any] | None = None
) -> list[Shortfall]:
    """Find one thing that puts a result in doubt."""
    return [Shortfall(text, remedy, values or {})]


def bad(
    text: str, remedy: str, values: Mapping[str, Any] | None = None
) -> list[Shortfall]:
    """Find one thing that makes a result bad."""
    return [Shortfall(text, remedy, values or {}, State.BAD)]


@dataclass(frozen=True)  # with slots, Condition[X](...) would raise TypeError
class Condition(Generic[Evidence]):
    """A row of the table of conditions of a kind of result.

    Attributes:
        code: Its name in reasons, in snake case.
        statement: What is to be established.
        check: Looks whether it is, given the evidence.
    """

    code: str
    statement: str
    check: Callable[[Evidence], Finding]


def judge(table: Sequence[Condition[Evidence]], evidence: Evidence) -> Outcome:
    """Check every condition of a table; a table without any establishes nothing."""
    reasons: list[Reason] = []
    established: dict[str, Mapping[str, Any]] = {}
    for condition in table:
        finding = condition.check(evidence)
        if isinstance(finding, Established):
            established[condition.code] = finding.values
            continue
        reasons += [
            Reason(
                condition.code,
                shortfall.state,
                shortfall.text,
                shortfall.remedy,
                shortfall.values,
            )
            for shortfall in finding or [_unknown(condition)]
        ]
    if not table:
        reasons.append(
            Reason("no_conditions", State.DOUBT, "Nothing was judged.", "", {})
        )
    return Outcome(
        worst(reason.state for reason in reasons), tuple(reasons), established
    )


def _unknown(condition: Condition[Evidence]) -> Shortfall:
    return Shortfall(f"It is not established that {condition.statement}.", "")


def worst(states: Iterable[State]) -> State:
    """Return the worst of several states; good for none."""
    return max(states, key=_ORDER.index, default=State.GOOD)
