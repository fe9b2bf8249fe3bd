"""`make prove-alignment`: predicted errors against true ones, the index as an order.

10 000 random dispositions of common points, each with errors of its own on both sides,
are measured once and aligned. The truth is known, so the error in the volume is, too.
Whether the index orders dispositions as the true error does is tested with another
computation: many measurements with equal errors, fitted by singular values (Kabsch).
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.alignment.degenerate import NO_FLAG, REFUSED, degenerate
from benchmarks.alignment.point_distributions import Outcome, drawn_measurement, run
from benchmarks.trials.lines import Line, outcomes
from benchmarks.trials.program import Program, Verdict
from benchmarks.trials.series import Series
from traverse.arrays import Floats

N_DISPOSITIONS, BATCH = 10_000, 100
DISPOSITIONS = "dispositions"
N_DEGENERATE = 200
LOW, HIGH = 0.95, 1.05
LEAST_CORRELATION = 0.99
_WEAK = ("two points", "one point", "on a line", "on a line within the errors")


def series(_asked: argparse.Namespace) -> list[Series[Any]]:
    return [Series(DISPOSITIONS, drawn_measurement, run, N_DISPOSITIONS, BATCH)]


def judge(lines: Sequence[Line]) -> Verdict:
    outcomes_of_trials = _outcomes(lines)
    report = {
        "ratios": ratios(outcomes_of_trials),
        "order": order(outcomes_of_trials),
        "degenerate": degenerate(N_DEGENERATE),
    }
    return Verdict("\n".join(_shown(report)), _is_kept(report))


def _outcomes(lines: Sequence[Line]) -> list[Outcome]:
    values: list[dict[str, Any]] = [
        {key: float("nan") if value is None else value for key, value in each.items()}
        for each in outcomes(lines, DISPOSITIONS)
    ]
    return [Outcome(**each) for each in values]


def ratios(outcomes_of_trials: Sequence[Outcome]) -> dict[str, dict[str, float]]:
    """Compare observed with predicted errors, by class."""
    usable = [outcome for outcome in outcomes_of_trials if not outcome.refused]
    classes = {
        "all": usable,
        "no flag": [outcome for outcome in usable if not outcome.flags],
        "nearly collinear": _flagged(usable, "nearly_collinear"),
        "coplanar": _flagged(usable, "coplanar"),
        "small for the volume": _flagged(usable, "small_for_the_volume"),
    }
    return {
        name: {"n": len(part), **ratio(part)} for name, part in classes.items() if part
    }


def _flagged(outcomes_of_trials: Sequence[Outcome], code: str) -> list[Outcome]:
    return [outcome for outcome in outcomes_of_trials if code in outcome.flags]


def ratio(outcomes_of_trials: Sequence[Outcome]) -> dict[str, float]:
    """Return the root mean square ratio of observed to predicted errors."""
    squares = np.array(
        [
            (outcome.observed_mm / outcome.predicted_mm) ** 2
            for outcome in outcomes_of_trials
        ]
    )
    value = float(np.sqrt(squares.mean()))
    return {
        "ratio": value,
        "ratio_std": float(squares.std() / np.sqrt(len(squares)) / (2.0 * value)),
        "largest": float(np.sqrt(squares.max())),
        "predicted_mm": float(
            np.median([outcome.predicted_mm for outcome in outcomes_of_trials])
        ),
        "residual_mm": float(
            np.median([outcome.residual_mm for outcome in outcomes_of_trials])
        ),
    }


def order(outcomes_of_trials: Sequence[Outcome]) -> dict[str, float]:
    """Compute rank correlations with the true error, of all dispositions."""
    true = np.array([outcome.true_mm for outcome in outcomes_of_trials])
    usable = [outcome for outcome in outcomes_of_trials if not outcome.refused]
    observed = np.array([outcome.observed_mm for outcome in usable])
    return {
        "index": rank_correlation(
            np.array([outcome.index for outcome in outcomes_of_trials]), true
        ),
        "fit": rank_correlation(
            np.array([outcome.fit_mm for outcome in outcomes_of_trials]), true
        ),
        "predicted_single": rank_correlation(
            np.array([outcome.predicted_mm for outcome in usable]), observed
        ),
        "residual_single": rank_correlation(
            np.array([outcome.residual_mm for outcome in usable]), observed
        ),
        "refused": len(outcomes_of_trials) - len(usable),
    }


def rank_correlation(x: Floats, y: Floats) -> float:
    """Compute Spearman's coefficient of values without ties."""
    of_x, of_y = (np.argsort(np.argsort(part)) for part in (x, y))
    return float(np.corrcoef(of_x, of_y)[0, 1])


def _shown(report: dict[str, Any]) -> Iterator[str]:
    correlations = report["order"]
    yield (
        "| class | n | observed / predicted | largest | predicted [mm], median | "
        "residuals [mm], median |\n|---|---|---|---|---|---|"
    )
    for name, row in report["ratios"].items():
        yield (
            f"| {name} | {row['n']} | {row['ratio']:.3f} ± {row['ratio_std']:.3f} | "
            f"{row['largest']:.1f} | {row['predicted_mm']:.4f} | "
            f"{row['residual_mm']:.4f} |"
        )
    yield f"\nrefused: {correlations['refused']}"
    for quantity, key in (("the index", "index"), ("residuals", "fit")):
        value = correlations[key]
        yield f"rank correlation of {quantity} with the true error: {value:.4f}"
    yield (
        "with the error of a single measurement: predicted "
        f"{correlations['predicted_single']:.4f}, residuals "
        f"{correlations['residual_single']:.4f}"
    )
    yield "\n| points | said, of 200 | for example |\n|---|---|---|"
    for kind, row in report["degenerate"].items():
        codes = ", ".join(f"{code} {n}" for code, n in row["said"].items())
        yield f"| {kind} | {codes} | {row['example']} |"


def _is_kept(report: dict[str, Any]) -> bool:
    kinds = report["degenerate"]
    silent = [k for k, row in kinds.items() if k != "wide" and NO_FLAG in row["said"]]
    refused = all(kinds[kind]["said"] == {REFUSED: N_DEGENERATE} for kind in _WEAK)
    ordered = report["order"]["index"] >= LEAST_CORRELATION
    in_limits = LOW <= report["ratios"]["all"]["ratio"] <= HIGH
    return in_limits and ordered and refused and not silent


def _paint(lines: Sequence[Line], folder: Path) -> None:
    from benchmarks.alignment.pictures import paint  # noqa: PLC0415 - heavy

    paint(_outcomes(lines), folder)


PROGRAM = Program("benchmarks.alignment", series, judge, paint=_paint)

if __name__ == "__main__":
    sys.exit(PROGRAM.main())
