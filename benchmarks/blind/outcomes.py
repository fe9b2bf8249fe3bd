"""One run of the blind test, as a line of a file."""

import time
import traceback
from dataclasses import asdict
from typing import Any

from benchmarks.blind.baselines import BASELINES
from benchmarks.blind.round import Case, find, gap_of, hide
from benchmarks.blind.scenarios import SCENARIOS
from benchmarks.blind.score import Identity, TrueTerm, scored
from benchmarks.proofs.campaigns import demo_arm
from traverse.lab.diagnosis.candidates.library import library_bank
from traverse.lab.diagnosis.model.observation_equations import equations_of
from traverse.lab.diagnosis.model.result import Diagnosis

Line = dict[str, Any]


def run(scenario: str, seed: int) -> Line:
    """Hide, find and score; what goes wrong is told in the line."""
    line: Line = {"scenario": scenario, "seed": seed, "error": None}
    begun_s = time.monotonic()
    try:
        case = hide(demo_arm(), SCENARIOS[scenario], seed)
        line |= _hidden(case)
        hidden_s = time.process_time()
        diagnosis = find(case)
        # Of a core: how many others there are does not matter.
        line["seconds"] = time.process_time() - hidden_s
        line |= _found(diagnosis)
        line["score"] = asdict(scored(case.truths, diagnosis))
        line["gap"] = gap_of(case, diagnosis)
        line["rivals"] = _rivals(case, diagnosis)
    except Exception:  # noqa: BLE001 - a run that breaks is a result too
        line["error"] = traceback.format_exc()
    line["seconds_in_all"] = time.monotonic() - begun_s
    return line


def _hidden(case: Case) -> Line:
    hidden = [
        {
            "identity": list(truth.identity),
            "keys": {key: str(value) for key, value in one.keys.items()},
            "aliases": sorted(
                [list(name) for name in truth.aliases - {truth.identity}], key=str
            ),
            "likeness": likeness,
        }
        for truth, one, likeness in zip(
            case.truths, case.hidden, case.likeness, strict=True
        )
    ]
    return {"pose_seed": case.pose_seed, "hidden": hidden}


def _found(diagnosis: Diagnosis) -> Line:
    terms = [
        {
            "name": term.candidate.name,
            "status": term.status,
            "log_bayes_factor": term.log_bayes_factor,
            "alternatives": [
                other.candidate.name + ("*" if other.alias else "")
                for other in term.alternatives
            ],
        }
        for term in diagnosis.terms
    ]
    return {"verdict": diagnosis.verdict, "terms": terms}


def _rivals(case: Case, diagnosis: Diagnosis) -> Line:
    """Ask the rivals, on the poses that do not contradict the others."""
    rows = equations_of(diagnosis.before)
    bank = library_bank(rows, case.arm)
    names = frozenset().union(*(truth.names for truth in case.truths))
    answers: Line = {}
    for name, rival in BASELINES.items():
        answer = rival(rows, bank)
        first = answer.names[0] if answer.names else None
        answers[name] = {
            "detected": answer.detected,
            "exact": first in names,
            "all_exact": _all_of(answer.names, case.truths),
        }
    return answers


def _all_of(names: tuple[Identity, ...], truths: tuple[TrueTerm, ...]) -> bool:
    """Say whether these are the true names, each once, and no others."""
    return len(names) == len(truths) and all(
        any(name in truth.names for name in names) for truth in truths
    )
