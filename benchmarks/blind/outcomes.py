"""Scenarios of the blind test, and the outcomes of their rounds."""

import time
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from types import MappingProxyType

from benchmarks.blind.baselines import BASELINES
from benchmarks.blind.round import Case, Scenario, find, gap_of, hide
from benchmarks.blind.score import Identity, TrueTerm, scored
from benchmarks.proofs.conditions import demo_arm
from benchmarks.trials.lines import Line
from benchmarks.trials.series import Series
from traverse.lab.diagnosis.candidates.library import library_bank
from traverse.lab.diagnosis.model.observation_equations import equations_of
from traverse.lab.diagnosis.model.result import Diagnosis

# The campaign states a noise that is too small by this.
_TOO_SMALL = 1.0 / 1.4
_SERIAL_SHARE = 0.3

# Every scenario has a stream of its own, but those with blunders: they are compared
# with the same effects in the same noise without them.
CLEAN = (
    Scenario("clean, noise known", stream=1),
    Scenario("clean, noise 1.4 x stated", stated_factor=_TOO_SMALL, stream=2),
    Scenario("clean, noise serial", serial_share=_SERIAL_SHARE, stream=3),
)
ONE = tuple(
    Scenario(f"one at {size}", 1, size, stream=10 + size) for size in (6, 8, 10, 14, 20)
)
TWO = tuple(
    Scenario(f"two at {size}", 2, size, stream=40 + size) for size in (6, 8, 10, 14)
)
THREE = Scenario("three at 10", 3, 10, stream=70)
BLUNDERS = tuple(
    Scenario(f"one at 8, {share:.0%} blunders", 1, 8, blunder_share=share, stream=18)
    for share in (0.02, 0.05)
)
OUTSIDE = tuple(
    Scenario(f"outside at {size}", 1, size, outside=True, stream=80 + size)
    for size in (10, 15)
)

SCENARIOS: Mapping[str, Scenario] = MappingProxyType(
    {s.name: s for s in (*CLEAN, *ONE, *TWO, THREE, *BLUNDERS, *OUTSIDE)}
)

# Runs of each in `make blind`, 200 in all.
QUICK: Mapping[str, int] = MappingProxyType(
    {
        **dict.fromkeys((s.name for s in CLEAN), 20),
        **dict.fromkeys((s.name for s in ONE), 14),
        **dict.fromkeys((s.name for s in TWO), 8),
        THREE.name: 2,
        **dict.fromkeys((s.name for s in BLUNDERS), 8),
        **dict.fromkeys((s.name for s in OUTSIDE), 10),
    }
)
# What it takes until the interval of a rate is as narrow as its figure deserves.
FULL: Mapping[str, int] = MappingProxyType(
    {
        **dict.fromkeys((s.name for s in CLEAN), 400),
        **dict.fromkeys((s.name for s in ONE), 300),
        **dict.fromkeys((s.name for s in TWO), 150),
        THREE.name: 100,
        **dict.fromkeys((s.name for s in BLUNDERS), 300),
        **dict.fromkeys((s.name for s in OUTSIDE), 200),
    }
)


def series(counts: Mapping[str, int], *, knows_masses: bool) -> list[Series[Case]]:
    run = partial(find_and_score, knows_masses=knows_masses)
    return [
        Series(name, partial(_hide, SCENARIOS[name]), run, n)
        for name, n in counts.items()
    ]


def _hide(scenario: Scenario, seed: int) -> Case:
    return hide(demo_arm(), scenario, seed)


def find_and_score(case: Case, *, knows_masses: bool = True) -> Line:
    begun_s = time.process_time()
    diagnosis = find(case, knows_masses=knows_masses)
    # Of a core: how many others there are does not matter.
    seconds = time.process_time() - begun_s
    return {
        **_hidden(case),
        "seconds": seconds,
        **_named_terms(diagnosis),
        "score": asdict(scored(case.truths, diagnosis)),
        "gap": gap_of(case, diagnosis),
        "rivals": _rivals(case, diagnosis),
    }


def _hidden(case: Case) -> Line:
    hidden = [
        {
            "identity": list(truth.identity),
            "keys": {key: str(value) for key, value in effect.keys.items()},
            "aliases": sorted(
                [list(name) for name in truth.aliases - {truth.identity}], key=str
            ),
            "likeness": likeness,
        }
        for truth, effect, likeness in zip(
            case.truths, case.hidden, case.likeness, strict=True
        )
    ]
    return {"pose_seed": case.pose_seed, "hidden": hidden}


def _named_terms(diagnosis: Diagnosis) -> Line:
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
    """Run the rivals, on the poses that do not contradict the others."""
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
    """Return whether these are the true names, each once, and no others."""
    return len(names) == len(truths) and all(
        any(name in truth.names for name in names) for truth in truths
    )
