"""What must be established before an arm is accepted."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Outcome,
    Shortfall,
    State,
    judge,
)

_VERIFY = "Measure what is missing, and verify again."


@dataclass(frozen=True, slots=True)
class DecidedFigure:
    """A figure of an acceptance test and its decision.

    Attributes:
        verdict: accept, reject, neither, undecided; None without a limit.
        remarks: What was not done as the standard says.
    """

    name: str
    value_mm: float | None
    limit_mm: float | None
    verdict: str | None
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class AcceptanceEvidence:
    """Figures of an acceptance test, and the names of those that are missing."""

    figures: Sequence[DecidedFigure]
    missing: Sequence[str]


Finding = Established | Sequence[Shortfall]


def _complete(evidence: AcceptanceEvidence) -> Finding:
    if not evidence.missing and evidence.figures:
        return Established({"n_figures": len(evidence.figures)})
    names = ", ".join(evidence.missing) or "all figures"
    text = f"Incomplete: {names} not computed."
    return [Shortfall(text, _VERIFY, {"missing": list(evidence.missing)})]


def _limited(evidence: AcceptanceEvidence) -> Finding:
    names = [figure.name for figure in evidence.figures if figure.verdict is None]
    if not names:
        return Established() if evidence.figures else []
    text = f"No limit is given for {', '.join(names)}: nothing is decided there."
    return [Shortfall(text, "Give the limits with --limits.", {"figures": names})]


def _within(evidence: AcceptanceEvidence) -> Finding:
    return [
        Shortfall(
            f"{figure.name} is rejected.",
            "Do not use the arm as accepted.",
            {"value_mm": figure.value_mm, "limit_mm": figure.limit_mm},
            State.BAD,
        )
        for figure in evidence.figures
        if figure.verdict == "reject"
    ] or Established()


def _decided(evidence: AcceptanceEvidence) -> Finding:
    texts = {
        "neither": (
            "is neither accepted nor rejected: it lies within the uncertainty of the "
            "test about the limit.",
            "Test with a better standard.",
        ),
        "undecided": (
            "is not decided: an uncertainty that the rule needs is not stated.",
            "State it with the limits.",
        ),
    }
    return [
        Shortfall(
            f"{figure.name} {texts[figure.verdict][0]}",
            texts[figure.verdict][1],
            {"value_mm": figure.value_mm, "limit_mm": figure.limit_mm},
        )
        for figure in evidence.figures
        if figure.verdict in texts
    ] or Established()


def _as_prescribed(evidence: AcceptanceEvidence) -> Finding:
    return [
        Shortfall(f"{figure.name}: {remark}.", "", {"figure": figure.name})
        for figure in evidence.figures
        for remark in figure.remarks
    ] or Established()


CONDITIONS: tuple[Condition[AcceptanceEvidence], ...] = (
    Condition("within", "no figure is rejected", _within),
    Condition("complete", "all figures of the standard are computed", _complete),
    Condition("decided", "every figure with a limit is decided", _decided),
    Condition("limited", "every figure has a limit", _limited),
    Condition("prescribed", "it was measured as the standard says", _as_prescribed),
)


@dataclass(frozen=True, slots=True)
class AcceptanceOutcome:
    """What an acceptance test concludes.

    Attributes:
        title: In a few words.
        sentences: What was decided of which figures.
    """

    outcome: Outcome
    title: str
    sentences: tuple[str, ...]


def acceptance_outcome(evidence: AcceptanceEvidence) -> AcceptanceOutcome:
    """Judge an acceptance test by its table of conditions."""
    outcome = judge(CONDITIONS, evidence)
    sentences = tuple(_sentences(evidence))
    return AcceptanceOutcome(outcome, _title(outcome, evidence), sentences)


# The worst first.
_DECISIONS = {
    "reject": "Rejected",
    "undecided": "No decision by ISO 14253-1",
    "neither": "Neither accepted nor rejected",
    "accept": "Accepted",
}


def _sentences(evidence: AcceptanceEvidence) -> Iterator[str]:
    """Say what was decided; figures that are accepted only beside others."""
    by_verdict: dict[str | None, list[str]] = {}
    for figure in evidence.figures:
        by_verdict.setdefault(figure.verdict, []).append(figure.name)
    without = ", ".join(by_verdict.pop(None, []))
    if evidence.missing:
        yield f"Incomplete: {', '.join(evidence.missing)} not computed."
    elif not by_verdict:
        yield "Complete; no limits given, so nothing is decided."
    elif set(by_verdict) == {"accept"}:
        part = " as far as there are limits" if without else ""
        yield f"Complete: accepted{part}."
    else:
        yield "Complete."
    if set(by_verdict) != {"accept"}:
        for verdict, text in _DECISIONS.items():
            if verdict in by_verdict:
                yield f"{text}: {', '.join(by_verdict[verdict])}."
    if without and by_verdict:
        yield f"Without a limit: {without}."


def _title(outcome: Outcome, evidence: AcceptanceEvidence) -> str:
    verdicts = {figure.verdict for figure in evidence.figures}
    for verdict, title in _DECISIONS.items():
        if verdict in verdicts and verdict != "accept":
            return title
    if "complete" in outcome.codes:
        return "Incomplete"
    if verdicts == {None}:
        return "Nothing decided: no limits given"
    if None in verdicts:
        return "Accepted in part"
    return "Accepted" if outcome.state is State.GOOD else "Accepted, with reservations"
