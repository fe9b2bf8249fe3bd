"""What a round of the blind test came to, in words and as plain values."""

from dataclasses import asdict
from typing import Any

from benchmarks.blind.round import Case
from benchmarks.blind.score import Score
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report import summary_lines


def round_lines(case: Case, diagnosis: Diagnosis, score: Score) -> list[str]:
    """Tell what was found, what was hidden, and how they compare."""
    lines = summary_lines(diagnosis)
    for hidden in hidden_table(case):
        keys = ", ".join(f"{key} = {value}" for key, value in hidden["keys"].items())
        lines.append(f"hidden: {hidden['name']}: {keys}")
    if not case.hidden:
        lines.append("hidden: nothing")
    return [*lines, f"score: {score_in_words(case, score)}"]


def round_json(case: Case, diagnosis: Diagnosis, score: Score) -> dict[str, Any]:
    """Put the same into plain values."""
    return {
        "seed": case.seed,
        "size": case.scenario.size,
        "hidden": hidden_table(case),
        "verdict": diagnosis.verdict,
        "found": [
            {
                "name": term.candidate.name,
                "status": term.status,
                "alternatives": [o.candidate.name for o in term.alternatives],
            }
            for term in diagnosis.terms
        ],
        "score": asdict(score),
        "in_words": score_in_words(case, score),
    }


def hidden_table(case: Case) -> list[dict[str, Any]]:
    """Say what was hidden, in the keys of an arm file."""
    return [
        {
            "name": " ".join(str(p) for p in truth.identity if p is not None),
            "keys": {key: _shown(value) for key, value in one.keys.items()},
        }
        for truth, one in zip(case.truths, case.hidden, strict=True)
    ]


def score_in_words(case: Case, score: Score) -> str:
    """Put the score into a sentence."""
    if not case.hidden:
        return "a false alarm" if score.detected else "right: nothing was hidden"
    if not score.detected:
        return "missed"
    if case.scenario.outside:
        return _outside(score)
    return _inside(len(case.hidden), score)


def _inside(n: int, score: Score) -> str:
    if score.all_exact:
        return "found by its right name" if n == 1 else "all found by their right names"
    if score.n_matched:
        spurious = f", and {score.n_spurious} more" if score.n_spurious else ""
        return f"{score.n_matched} of {n} found by their right names{spurious}"
    if score.in_set:
        return "not the first name, but among those that cannot be excluded"
    return "seen, at the right joint" if score.right_joint else "seen, but not found"


def _outside(score: Score) -> str:
    if score.confident_wrong:
        return "wrong: it was given a name, and it has none"
    where = "at the right joint" if score.right_joint else "at another joint"
    return f"{'called unknown' if score.unknown else 'left open'}, {where}"


def _shown(value: object) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_shown(part) for part in value) + "]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
