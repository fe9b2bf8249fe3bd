"""`make prove-acceptance`: how often acceptance is wrong, with guard bands or without.

A thousand simulated arms are tested by ISO 10360-12. The true value of each figure is
the one that exact standards at an exactly known temperature would give with the same
touches. The certificates and the thermometer used have errors; the
stated uncertainty is computed as in every certificate of acceptance. All arms are near
their limit: it is drawn within three standard uncertainties of the true figure.
"""

import argparse
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.acceptance.arms import (
    FIGURES,
    N_AGAIN,
    RULES,
    Tested,
    again,
    limits_of,
    tested_arm,
)
from benchmarks.tools.rounds import write_json
from benchmarks.tools.workers import add_workers, ordered
from traverse.arrays import Floats
from traverse.lab.acceptance.conformity import decision_of


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; 1 if the rule does not keep its promise."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.acceptance.__main__")
    parser.add_argument("--arms", type=int, default=1000)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--out", type=Path, help="file for the figures, JSON")
    parser.add_argument("--pictures", type=Path, help="folder for the pictures")
    add_workers(parser)
    given = parser.parse_args(arguments)
    begun_s = time.monotonic()
    seeds = range(given.first, given.first + given.arms)
    found = ordered(given.scheduler, tested_arm, seeds, 10)
    report: dict[str, Any] = {"arms": given.arms, "first_seed": given.first}
    report["rates"] = [row for key in FIGURES for row in rates(found, key)]
    report["procedure"] = list(procedure_rates(found))
    report["agreement"] = [agreement(found, key) for key in FIGURES]
    report["coverage"] = coverage(found)
    report["again"] = again(given.first)
    print(f"{given.arms} arms in {time.monotonic() - begun_s:.0f} s")
    _print(report)
    write_json(given.out, report)
    if given.pictures:
        from benchmarks.acceptance.pictures import paint  # noqa: PLC0415 - heavy

        paint(found, given.pictures)
    kept = [r["false_accept"] <= 0.05 for r in report["rates"] if r["rule"] != "simple"]
    return 0 if all(kept) else 1


def limits_mm(found: Sequence[Tested], key: str) -> Floats:
    """Take the limit of every arm, (n_arms,)."""
    return np.array([arm.limit_mm[key] for arm in found])


def verdicts(found: Sequence[Tested], key: str, rule: str) -> NDArray[np.str_]:
    """Decide on every arm by its figure alone."""
    limits = limits_of(rule)
    return np.array(
        [
            decision_of(
                arm.found_mm[key], arm.limit_mm[key], arm.standard_mm[key], limits
            ).verdict
            for arm in found
        ]
    )


def rates(found: Sequence[Tested], key: str) -> Iterator[dict[str, Any]]:
    """Count wrong decisions by rule."""
    for rule in RULES:
        yield _rates(found, key, rule, verdicts(found, key, rule))


def procedure_rates(found: Sequence[Tested]) -> Iterator[dict[str, Any]]:
    """Count the same of E_UNI with the rule for repeats."""
    for rule in RULES:
        verdict = np.array([arm.procedure[rule] for arm in found])
        row = _rates(found, "e_uni", rule, verdict)
        yield {**row, "figure": "e_uni with repeats"}


def _rates(
    found: Sequence[Tested], key: str, rule: str, verdict: NDArray[np.str_]
) -> dict[str, Any]:
    true = np.array([arm.true_mm[key] for arm in found])
    good = true <= limits_mm(found, key)
    return {
        "figure": key,
        "rule": rule,
        "u_mm": float(np.mean([arm.standard_mm[key] for arm in found])),
        "good": int(good.sum()),
        "bad": int((~good).sum()),
        "false_accept": float(np.mean(verdict[~good] == "accept")),
        "false_reject": float(np.mean(verdict[good] == "reject")),
        "accepted_good": float(np.mean(verdict[good] == "accept")),
        "rejected_bad": float(np.mean(verdict[~good] == "reject")),
        "neither": float(np.mean(verdict == "neither")),
    }


def agreement(found: Sequence[Tested], key: str) -> dict[str, Any]:
    """Compare figures with the truth."""
    true = np.array([arm.true_mm[key] for arm in found])
    measured = np.array([arm.found_mm[key] for arm in found])
    u_mm = np.array([arm.standard_mm[key] for arm in found])
    off = measured - true
    return {
        "figure": key,
        "true_mm": [float(np.quantile(true, q)) for q in (0.05, 0.5, 0.95)],
        "mean_off_mm": float(off.mean()),
        "rms_off_mm": float(np.sqrt(np.mean(off**2))),
        "rms_off_u": float(np.sqrt(np.mean((off / u_mm) ** 2))),
        "within_2u": float(np.mean(np.abs(off) <= 2.0 * u_mm)),
        "correlation": float(np.corrcoef(true, measured)[0, 1]),
    }


def coverage(found: Sequence[Tested]) -> dict[str, float]:
    """Return how often single lengths are off by no more than U."""
    true, measured, u_mm = np.array([row for arm in found for row in arm.lengths]).T
    off = np.abs(measured - true)
    return {
        "lengths": len(off),
        "within_2u": float(np.mean(off <= 2.0 * u_mm)),
        "rms_u": float(np.sqrt(np.mean((off / u_mm) ** 2))),
    }


def _print(report: dict[str, Any]) -> None:
    print(
        "\n| figure | rule | u [um] | bad arms accepted | good arms "
        "rejected | good accepted | bad rejected | neither |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for row in [*report["rates"], *report["procedure"]]:
        cells = [row["figure"], row["rule"]]
        cells += [f"{1e3 * row['u_mm']:.2f}"]
        names = ("false_accept", "false_reject", "accepted_good", "rejected_bad")
        cells += [f"{row[name]:.1%}" for name in (*names, "neither")]
        print(f"| {' | '.join(cells)} |")
    print("\n| figure | true 5 %, 50 %, 95 % [um] | rms off [um] | in u | within 2 u |")
    print("|---|---|---|---|---|")
    for row in report["agreement"]:
        true = ", ".join(f"{1e3 * value:.1f}" for value in row["true_mm"])
        print(
            f"| {row['figure']} | {true} | {1e3 * row['rms_off_mm']:.2f} | "
            f"{row['rms_off_u']:.2f} | {row['within_2u']:.1%} |"
        )
    found = report["coverage"]
    print(
        f"\n{found['lengths']} lengths: {found['within_2u']:.1%} within 2 u, rms "
        f"{found['rms_u']:.2f} u"
    )
    print(f"\n| one arm, {N_AGAIN} tests | mean [um] | std | least | largest |")
    print("|---|---|---|---|---|")
    for key, own in report["again"].items():
        cells = [f"{1e3 * value:.1f}" for value in own.values()]
        print(f"| {key} | {' | '.join(cells)} |")


if __name__ == "__main__":
    raise SystemExit(main())
