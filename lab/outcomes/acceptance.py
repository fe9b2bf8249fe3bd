"""What must be established before an arm is accepted."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Finding,
    Outcome,
    Shortfall,
    State,
    bad,
    doubt,
    judge,
)

_VERIFY = "Measure what is missing, and verify again."
FIGURES_ONLY = "Figures only: not a certificate"
# What is decided of a figure, by its verdict, the worst first.
VERDICT_WORDS = {
    "withheld": "figures only",
    "reject": "rejected",
    "undecided": "no decision, for want of an uncertainty",
    "neither": "neither accepted nor rejected",
    "accept": "accepted",
    None: "no limit given",
}


@dataclass(frozen=True, slots=True)
class DecidedFigure:
    """A figure of an acceptance test and its decision.

    Attributes:
        verdict: By its limit alone: accept, reject, neither, undecided; None without.
        remarks: What was not done as the standard says.
    """

    name: str
    value_mm: float | None
    limit_mm: float | None
    verdict: str | None
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class AbsentStatement:
    """A statement that a verdict rests on and that nobody made.

    Attributes:
        code: Its name in JSON.
        text: What is to be stated, without an article.
        where: Key and file.
        names: Of which standards it is absent; "" for the measurement as a whole.
    """

    code: str
    text: str
    where: str
    names: tuple[str, ...]

    @property
    def subject(self) -> str:
        """What is missing, and of what."""
        names = ", ".join(filter(None, self.names))
        return f"{self.text} of {names}" if names else self.text


@dataclass(frozen=True, slots=True)
class AcceptanceEvidence:
    """Figures of an acceptance test, and the obstacles to a verdict.

    Attributes:
        missing: Names of figures that were not computed.
        contradictions: By which touches cannot be of this arm and these artefacts, a
            clause each.
    """

    figures: Sequence[DecidedFigure]
    missing: Sequence[str]
    absent: Sequence[AbsentStatement] = ()
    contradictions: Sequence[str] = ()


_MOST_CLAUSES = 3
_FOREIGN = "Arm file, poses and artefacts do not belong together"


def _belongs(evidence: AcceptanceEvidence) -> Finding:
    clauses = evidence.contradictions
    if not clauses:
        return Established()
    n_more = len(clauses) - _MOST_CLAUSES
    named = "; ".join(clauses[:_MOST_CLAUSES])
    more = f"; and {n_more} more" if n_more > 0 else ""
    return bad(
        f"{_FOREIGN}: {named}{more}. No arm is off by so much.",
        "Look whether the readings are in radians and the lengths in mm, and whether "
        "poses, arm file and certificates are of this arm and this campaign.",
        {"n_contradictions": len(clauses)},
    )


def _stated(evidence: AcceptanceEvidence) -> Finding:
    return [
        Shortfall(
            f"Missing: {statement.subject}.",
            f"Give {statement.where}.",
            {"statement": statement.code, "of": list(filter(None, statement.names))},
        )
        for statement in evidence.absent
    ] or Established()


def _complete(evidence: AcceptanceEvidence) -> Finding:
    if not evidence.missing and evidence.figures:
        return Established({"n_figures": len(evidence.figures)})
    names = ", ".join(evidence.missing) or "all figures"
    text = f"Incomplete: {names} not computed."
    return doubt(text, _VERIFY, {"missing": list(evidence.missing)})


def _limited(evidence: AcceptanceEvidence) -> Finding:
    names = [figure.name for figure in evidence.figures if figure.verdict is None]
    if not names:
        return Established() if evidence.figures else []
    text = f"No limit is given for {', '.join(names)}: nothing is decided there."
    return doubt(text, "Give the limits with --limits.", {"figures": names})


def _within(evidence: AcceptanceEvidence) -> Finding:
    return [
        Shortfall(
            f"{figure.name} exceeds its limit.",
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
            "State what its budget lacks.",
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
    Condition("belongs", "touches are of this arm and its artefacts", _belongs),
    Condition("within", "no figure is rejected", _within),
    Condition("stated", "all that a verdict rests on is stated", _stated),
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
        sentences: What was decided of which figures, or what a verdict lacks.
        verdict: Of the whole: the worst of its figures'; withheld where a statement is
            absent, or touches contradict the rest; None where a figure is missing or
            has no limit.
        verdicts: Of the figures, in their order.
    """

    outcome: Outcome
    title: str
    sentences: tuple[str, ...]
    verdict: str | None
    verdicts: tuple[str | None, ...]


def acceptance_outcome(evidence: AcceptanceEvidence) -> AcceptanceOutcome:
    outcome = judge(CONDITIONS, evidence)
    without_basis = bool(evidence.absent or evidence.contradictions)
    verdicts = tuple(
        "withheld" if without_basis else figure.verdict for figure in evidence.figures
    )
    return AcceptanceOutcome(
        outcome,
        _FOREIGN if evidence.contradictions else _title(outcome, verdicts, evidence),
        (
            *(entry.sentence for entry in outcome.reasons if entry.code == "belongs"),
            *_sentences(evidence),
        ),
        _overall(verdicts, evidence),
        verdicts,
    )


def _overall(
    verdicts: Sequence[str | None], evidence: AcceptanceEvidence
) -> str | None:
    worst = next((word for word in VERDICT_WORDS if word in verdicts), None)
    is_open = None in verdicts or bool(evidence.missing)
    if evidence.absent or evidence.contradictions:
        return "withheld"
    return None if worst == "accept" and is_open else worst


def _sentences(evidence: AcceptanceEvidence) -> Iterator[str]:
    """Say what was decided; figures that are accepted only beside others."""
    by_verdict: dict[str | None, list[str]] = {}
    for figure in evidence.figures:
        by_verdict.setdefault(figure.verdict, []).append(figure.name)
    without = ", ".join(by_verdict.pop(None, []))
    if evidence.missing:
        yield f"Incomplete: {', '.join(evidence.missing)} not computed."
    if evidence.absent:
        yield "No verdict is given without what it rests on."
        for statement in evidence.absent:
            yield f"Missing: {statement.subject} ({statement.where})."
    if evidence.absent or evidence.contradictions:
        return
    if not evidence.missing and not by_verdict:
        yield "Complete; no limits given, so nothing is decided."
    elif not evidence.missing and set(by_verdict) == {"accept"}:
        part = " as far as there are limits" if without else ""
        reserved = any(figure.remarks for figure in evidence.figures)
        yield f"Complete: accepted{part}{', with reservations' if reserved else ''}."
    elif not evidence.missing:
        yield "Complete."
    if set(by_verdict) != {"accept"}:
        for verdict, words in VERDICT_WORDS.items():
            if verdict in by_verdict:
                yield f"{_capital(words)}: {', '.join(by_verdict[verdict])}."
    if without and by_verdict:
        yield f"Without a limit: {without}."


def _capital(words: str) -> str:
    return words[0].upper() + words[1:]


def _title(
    outcome: Outcome, verdicts: Sequence[str | None], evidence: AcceptanceEvidence
) -> str:
    if evidence.absent:
        return FIGURES_ONLY
    for verdict, words in VERDICT_WORDS.items():
        if verdict in verdicts and verdict not in ("accept", None):
            return _capital(words)
    if "complete" in outcome.codes:
        return "Incomplete"
    if set(verdicts) == {None}:
        return "Nothing decided: no limits given"
    if None in verdicts:
        return "Accepted in part"
    return "Accepted" if outcome.state is State.GOOD else "Accepted, with reservations"
