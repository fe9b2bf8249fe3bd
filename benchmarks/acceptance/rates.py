"""Rates of wrong decisions on the simulated arms, and errors of figures."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.acceptance.arms import RULES, Tested, limits_of
from traverse.arrays import Floats
from traverse.lab.acceptance.conformity import decision_of


def limits_mm(tested: Sequence[Tested], key: str) -> Floats:
    """Take the limit of every arm, (n_arms,)."""
    return np.array([arm.limit_mm[key] for arm in tested])


def verdicts(tested: Sequence[Tested], key: str, rule: str) -> NDArray[np.str_]:
    """Decide on every arm by its figure alone."""
    limits = limits_of(rule)
    return np.array(
        [
            decision_of(
                arm.found_mm[key], arm.limit_mm[key], arm.standard_mm[key], limits
            ).verdict
            for arm in tested
        ]
    )


def rates(tested: Sequence[Tested], key: str) -> Iterator[dict[str, Any]]:
    """Count wrong decisions by rule."""
    for rule in RULES:
        yield _rates(tested, key, rule, verdicts(tested, key, rule))


def procedure_rates(tested: Sequence[Tested]) -> Iterator[dict[str, Any]]:
    """Count wrong decisions on E_UNI with the rule for repeats."""
    for rule in RULES:
        verdict = np.array([arm.procedure[rule] for arm in tested])
        row = _rates(tested, "e_uni", rule, verdict)
        yield {**row, "figure": "e_uni with repeats"}


def _rates(
    tested: Sequence[Tested], key: str, rule: str, verdict: NDArray[np.str_]
) -> dict[str, Any]:
    true = np.array([arm.true_mm[key] for arm in tested])
    good = true <= limits_mm(tested, key)
    return {
        "figure": key,
        "rule": rule,
        "u_mm": float(np.mean([arm.standard_mm[key] for arm in tested])),
        "good": int(good.sum()),
        "bad": int((~good).sum()),
        "false_accept": float(np.mean(verdict[~good] == "accept")),
        "false_reject": float(np.mean(verdict[good] == "reject")),
        "accepted_good": float(np.mean(verdict[good] == "accept")),
        "rejected_bad": float(np.mean(verdict[~good] == "reject")),
        "neither": float(np.mean(verdict == "neither")),
    }


def agreement(tested: Sequence[Tested], key: str) -> dict[str, Any]:
    true = np.array([arm.true_mm[key] for arm in tested])
    measured = np.array([arm.found_mm[key] for arm in tested])
    u_mm = np.array([arm.standard_mm[key] for arm in tested])
    expanded_mm = np.array([arm.expanded_mm[key] for arm in tested])
    off = measured - true
    return {
        "figure": key,
        "true_mm": [float(np.quantile(true, q)) for q in (0.05, 0.5, 0.95)],
        "rms_off_mm": float(np.sqrt(np.mean(off**2))),
        "rms_off_u": float(np.sqrt(np.mean((off / u_mm) ** 2))),
        "covered": float(np.mean(np.abs(off) <= expanded_mm)),
    }


def coverage(tested: Sequence[Tested]) -> dict[str, float]:
    """Return how often single lengths are off by no more than U."""
    rows = np.array([row for arm in tested for row in arm.lengths])
    true, measured, u_mm, expanded_mm = rows.T
    off = np.abs(measured - true)
    true_size, size, size_expanded = np.array([arm.counted for arm in tested]).T
    size_off = size - true_size
    return {
        "lengths": len(off),
        "covered": float(np.mean(off <= expanded_mm)),
        "within_2u": float(np.mean(off <= 2.0 * u_mm)),
        "rms_u": float(np.sqrt(np.mean((off / u_mm) ** 2))),
        "counted_sizes": float(np.mean(np.abs(size_off) <= size_expanded)),
    }
