"""`make prove-acceptance`: how often acceptance is wrong, with guard bands or without.

A thousand simulated arms are tested by ISO 10360-12. The truth of each is the figure
that exact standards at an exactly known temperature would have given with the same
touches. What is measured has certificates with errors and a thermometer with one; its
stated uncertainty is computed as in every certificate of acceptance. All arms are near
their limit: it is drawn within three standard uncertainties of the true figure.
"""

import argparse
import json
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.arm_file import Arm, read_arm
from kinematics.forward import probe_centre
from kinematics.geometry import geometry_from_arm
from lab.acceptance.decision import decision_of
from lab.acceptance.figure import Figure, LengthError
from lab.acceptance.limits import Limits, Standards
from lab.acceptance.measured import Measured, Touched, reach_of
from lab.acceptance.standards import verified
from lab.identification.artefacts import artefact_from_table
from simulator.campaigns import NoiseTable
from simulator.campaigns.acceptance import (
    acceptance_poses,
    drawn_acceptance,
    touched_by,
)
from simulator.campaigns.campaign import SimulatedCampaign, StatedArtefact
from simulator.campaigns.pose_set import PoseSet
from simulator.truth import Deviations, true_arm

Floats = NDArray[np.float64]

ARM = Path(__file__).parent.parent / "traverse" / "demo_data" / "arm.toml"
STANDARD = "iso10360-12"
STD_MM = 0.0007
EXPANSION_PER_C = 11.5e-6
TEMPERATURE_STD_C = 0.1
NOISE = NoiseTable(encoder_rad=3e-6, contact_mm=0.003)
LINKS_MM, AXES_RAD = 0.004, 3e-6
NEAR_U = 3.0  # how far a limit is from the true figure, at most
N_AGAIN = 200
FIGURES = ("p_size", "e_uni")


@dataclass(frozen=True, slots=True)
class Tested:
    """One arm.

    Attributes:
        true_mm: Its figures by exact standards, by key.
        found_mm: Its figures as measured.
        standard_mm: Their stated standard uncertainties.
        lengths: Every measured length: true error, found error, uncertainty.
    """

    true_mm: dict[str, float]
    found_mm: dict[str, float]
    standard_mm: dict[str, float]
    lengths: tuple[tuple[float, float, float], ...]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; 1 if the rule does not keep its promise."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.acceptance")
    parser.add_argument("--arms", type=int, default=1000)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--out", type=Path, help="file for the figures, JSON")
    parser.add_argument("--pictures", type=Path, help="folder for the pictures")
    given = parser.parse_args(arguments)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    begun_s = time.monotonic()
    seeds = range(given.first, given.first + given.arms)
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        found = list(pool.map(tested_arm, seeds, chunksize=10))
    report: dict[str, Any] = {"arms": given.arms, "first_seed": given.first}
    report["rates"] = [row for key in FIGURES for row in rates(found, key)]
    report["agreement"] = [agreement(found, key) for key in FIGURES]
    report["coverage"] = coverage(found)
    report["again"] = again(given.first)
    print(f"{given.arms} arms in {time.monotonic() - begun_s:.0f} s")
    _print(report)
    if given.out:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        given.out.write_text(json.dumps(report, indent=1) + "\n", "utf-8")
    if given.pictures:
        from benchmarks.acceptance_pictures import paint  # noqa: PLC0415

        paint(found, given.pictures)
    kept = [r["false_accept"] <= 0.05 for r in report["rates"] if r["rule"] != "simple"]
    return 0 if all(kept) else 1


def tested_arm(seed: int) -> Tested:
    """Test one arm; its errors are half to one and a half of the usual ones."""
    arm, poses, exact = _prepared()
    rng = np.random.default_rng([seed, 0xACC])
    scale = rng.uniform(0.5, 1.5)
    deviations = Deviations(scale * LINKS_MM, scale * AXES_RAD, 0.0)
    mine = touched_by(poses, true_arm(arm, deviations, seed))
    drawn = drawn_acceptance(mine, seed)
    warm_c = 20.0 + TEMPERATURE_STD_C * float(rng.standard_normal())
    true = verified(_measured(arm, drawn, exact, 20.0), STANDARD, _limits())
    found = verified(
        _measured(arm, drawn, drawn.campaign.artefacts, warm_c), STANDARD, _limits()
    )
    return Tested(
        _values(true.figures),
        _values(found.figures),
        {figure.key: figure.budget.standard_mm for figure in found.figures},
        tuple(_paired(true.lengths, found.lengths)),
    )


_PREPARED: list[tuple[Arm, PoseSet, tuple[StatedArtefact, ...]]] = []


def _prepared() -> tuple[Arm, PoseSet, tuple[StatedArtefact, ...]]:
    """Find places and postures once a process."""
    if not _PREPARED:
        arm = read_arm(ARM)
        poses = acceptance_poses(arm, STANDARD, 1, noise=NOISE, std_mm=STD_MM)
        exact = acceptance_poses(arm, STANDARD, 1, noise=NOISE, std_mm=0.0)
        exact_artefacts = drawn_acceptance(exact, 1).campaign.artefacts
        _PREPARED.append((arm, poses, exact_artefacts))
    return _PREPARED[0]


def _limits() -> Limits:
    return Limits(
        schema="traverse/acceptance-limits/1",
        standards=Standards(temperature_std_c=TEMPERATURE_STD_C),
    )


def _measured(
    arm: Arm,
    drawn: SimulatedCampaign,
    artefacts: Sequence[StatedArtefact],
    warm_c: float,
) -> Measured:
    """Compute places with the arm file; standards are of steel."""
    campaign = drawn.campaign
    places_mm = probe_centre(geometry_from_arm(arm), campaign.readings_rad)
    tables = {
        entry.id: artefact_from_table(
            {
                "id": entry.id,
                "kind": entry.kind,
                **entry.table,
                "expansion_per_c": EXPANSION_PER_C,
            }
        )
        for entry in artefacts
    }
    touched = {}
    for name in tables:
        rows = np.flatnonzero(campaign.artefact == name)
        touched[name] = Touched(
            places_mm[rows],
            tuple(campaign.feature[rows].tolist()),
            np.full(len(rows), warm_c),
            np.full(len(rows), arm.probe.radius_mm),
        )
    shoulder_mm, reach_mm = reach_of(arm)
    return Measured(tables, touched, arm.name, shoulder_mm, reach_mm)  # type: ignore[arg-type] # made from tables


def _values(figures: Sequence[Figure]) -> dict[str, float]:
    return {figure.key: abs(figure.value_mm) for figure in figures}


def _paired(
    true: Sequence[LengthError], found: Sequence[LengthError]
) -> Iterator[tuple[float, float, float]]:
    for one, other in zip(true, found, strict=True):
        yield one.error_mm, other.error_mm, other.standard_mm


def limits_mm(found: Sequence[Tested], key: str) -> Floats:
    """Draw a limit for every arm, near its true figure."""
    rng = np.random.default_rng(len(key))
    near: Floats = rng.uniform(-NEAR_U, NEAR_U, len(found))
    true = np.array([arm.true_mm[key] for arm in found])
    return true + near * np.array([arm.standard_mm[key] for arm in found])


def verdicts(found: Sequence[Tested], key: str, rule: str) -> NDArray[np.str_]:
    """Decide on every arm."""
    limits = _limits()
    if rule == "simple":
        limits = limits.model_copy(update={"decision": "simple"})
    else:
        limits = limits.model_copy(update={"guard_factor": float(rule)})
    return np.array(
        [
            decision_of(
                arm.found_mm[key], limit_mm, arm.standard_mm[key], limits
            ).verdict
            for arm, limit_mm in zip(found, limits_mm(found, key), strict=True)
        ]
    )


def rates(found: Sequence[Tested], key: str) -> Iterator[dict[str, Any]]:
    """Count wrong decisions by rule."""
    true = np.array([arm.true_mm[key] for arm in found])
    good = true <= limits_mm(found, key)
    for rule in ("simple", "1.65", "2.0"):
        verdict = verdicts(found, key, rule)
        yield {
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
    """Say how often single lengths are off by no more than U."""
    true, measured, u_mm = np.array([row for arm in found for row in arm.lengths]).T
    off = np.abs(measured - true)
    return {
        "lengths": len(off),
        "within_2u": float(np.mean(off <= 2.0 * u_mm)),
        "rms_u": float(np.sqrt(np.mean((off / u_mm) ** 2))),
    }


def again(seed: int) -> dict[str, Any]:
    """Test one and the same arm many times, with exact standards."""
    arm, poses, exact = _prepared()
    mine = touched_by(poses, true_arm(arm, Deviations(LINKS_MM, AXES_RAD, 0.0), seed))
    values: dict[str, list[float]] = {}
    for test in range(N_AGAIN):
        drawn = drawn_acceptance(mine, 10_000 + test)
        found = verified(_measured(arm, drawn, exact, 20.0), STANDARD, _limits())
        for figure in found.figures:
            values.setdefault(figure.key, []).append(abs(figure.value_mm))
    return {
        key: {
            "mean_mm": float(np.mean(own)),
            "std_mm": float(np.std(own, ddof=1)),
            "least_mm": min(own),
            "largest_mm": max(own),
        }
        for key, own in values.items()
    }


def _print(report: dict[str, Any]) -> None:
    print(
        "\n| figure | rule | u [um] | bad arms accepted | good arms "
        "rejected | good accepted | bad rejected | neither |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for row in report["rates"]:
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
