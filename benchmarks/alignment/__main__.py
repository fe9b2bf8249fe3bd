"""`make prove-alignment`: predicted errors against true ones, the index as an order.

10 000 random dispositions of common points, each with errors of its own on both sides,
are measured once and aligned. The truth is known, so the error in the volume is, too.
Whether the index orders dispositions as the true error does is tested with another
computation: many measurements with equal errors, fitted by singular values (Kabsch).
"""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.alignment.degenerate import NO_FLAG, REFUSED, degenerate
from benchmarks.alignment.point_distributions import Outcome, outcome
from benchmarks.tools.rounds import write_json
from benchmarks.tools.workers import add_workers, ordered
from traverse.arrays import Floats

N_DEGENERATE = 200
LOW, HIGH = 0.95, 1.05
LEAST_CORRELATION = 0.99
_WEAK = ("two points", "one point", "on a line", "on a line within the errors")


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; 1 if a promise is not kept."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.alignment.__main__")
    parser.add_argument("--dispositions", type=int, default=10_000)
    parser.add_argument("--out", type=Path, help="file for the figures, JSON")
    parser.add_argument("--pictures", type=Path, help="folder for the pictures")
    add_workers(parser)
    given = parser.parse_args(arguments)
    begun_s = time.monotonic()
    seeds = range(given.dispositions)
    found = ordered(given.scheduler, outcome, seeds, 100)
    report = {
        "dispositions": given.dispositions,
        "ratios": ratios(found),
        "order": order(found),
        "degenerate": degenerate(N_DEGENERATE),
    }
    print(f"{given.dispositions} dispositions in {time.monotonic() - begun_s:.0f} s")
    _print(report)
    write_json(given.out, report)
    if given.pictures:
        from benchmarks.alignment.pictures import paint  # noqa: PLC0415 - heavy

        paint(found, given.pictures)
    return 0 if _is_kept(report) else 1


def ratios(found: Sequence[Outcome]) -> dict[str, dict[str, float]]:
    """Compare observed errors with predicted ones, over classes."""
    usable = [one for one in found if not one.refused]
    classes = {
        "all": usable,
        "no flag": [one for one in usable if not one.flags],
        "nearly collinear": _flagged(usable, "nearly_collinear"),
        "coplanar": _flagged(usable, "coplanar"),
        "small for the volume": _flagged(usable, "small_for_the_volume"),
    }
    return {
        name: {"n": len(part), **ratio(part)} for name, part in classes.items() if part
    }


def _flagged(found: Sequence[Outcome], code: str) -> list[Outcome]:
    return [one for one in found if code in one.flags]


def ratio(found: Sequence[Outcome]) -> dict[str, float]:
    """Say how observed errors are to predicted ones: root mean square of the ratio."""
    squares = np.array([(one.observed_mm / one.predicted_mm) ** 2 for one in found])
    value = float(np.sqrt(squares.mean()))
    return {
        "ratio": value,
        "ratio_std": float(squares.std() / np.sqrt(len(squares)) / (2.0 * value)),
        "largest": float(np.sqrt(squares.max())),
        "predicted_mm": float(np.median([one.predicted_mm for one in found])),
        "residual_mm": float(np.median([one.residual_mm for one in found])),
    }


def order(found: Sequence[Outcome]) -> dict[str, float]:
    """Compute rank correlations with the true error, of all dispositions."""
    true = np.array([one.true_mm for one in found])
    usable = [one for one in found if not one.refused]
    observed = np.array([one.observed_mm for one in usable])
    return {
        "index": rank_correlation(np.array([one.index for one in found]), true),
        "fit": rank_correlation(np.array([one.fit_mm for one in found]), true),
        "predicted_single": rank_correlation(
            np.array([one.predicted_mm for one in usable]), observed
        ),
        "residual_single": rank_correlation(
            np.array([one.residual_mm for one in usable]), observed
        ),
        "refused": len(found) - len(usable),
    }


def rank_correlation(x: Floats, y: Floats) -> float:
    """Compute Spearman's coefficient of values without ties."""
    of_x, of_y = (np.argsort(np.argsort(part)) for part in (x, y))
    return float(np.corrcoef(of_x, of_y)[0, 1])


def _print(report: dict[str, Any]) -> None:
    print(
        "\n| class | n | observed / predicted | largest | predicted [mm], median | "
        "residuals [mm], median |\n|---|---|---|---|---|---|"
    )
    for name, row in report["ratios"].items():
        print(
            f"| {name} | {row['n']} | {row['ratio']:.3f} ± {row['ratio_std']:.3f} | "
            f"{row['largest']:.1f} | {row['predicted_mm']:.4f} | "
            f"{row['residual_mm']:.4f} |"
        )
    found = report["order"]
    print(f"\nrefused: {found['refused']}")
    print(f"rank correlation of the index with the true error: {found['index']:.4f}")
    print(f"rank correlation of residuals with the true error: {found['fit']:.4f}")
    print(
        "with the error of a single measurement: predicted "
        f"{found['predicted_single']:.4f}, residuals {found['residual_single']:.4f}"
    )
    print("\n| points | said, of 200 | for example |\n|---|---|---|")
    for kind, row in report["degenerate"].items():
        said = ", ".join(f"{code} {n}" for code, n in row["said"].items())
        print(f"| {kind} | {said} | {row['example']} |")


def _is_kept(report: dict[str, Any]) -> bool:
    """Return whether every promise is kept."""
    ratio_of_all = report["ratios"]["all"]["ratio"]
    kinds = report["degenerate"]
    silent = [k for k, row in kinds.items() if k != "wide" and NO_FLAG in row["said"]]
    refused = all(kinds[kind]["said"] == {REFUSED: N_DEGENERATE} for kind in _WEAK)
    ordered = report["order"]["index"] >= LEAST_CORRELATION
    return LOW <= ratio_of_all <= HIGH and ordered and refused and not silent


if __name__ == "__main__":
    raise SystemExit(main())
