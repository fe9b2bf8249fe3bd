"""Convergence of random subsets of poses.

Of each of the sets of docs/strangers.md, and of simulated arms that a tracker follows.
None of these has wrong units: a report that says so is false.
"""

import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.strangers.sets import Measured, make_arm
from benchmarks.trials.lines import Line
from benchmarks.trials.series import Series
from tests.lab.identification.test_strangers import DESIGN, tracked
from tests.lab.simulated import Noise, arm_value
from traverse.kinematics.arm_file.arm import Arm, read_arm
from traverse.lab.adjustment.prepare import IdentificationError
from traverse.lab.campaign.campaign import Campaign, read_campaign
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.results.outcome import outcome_of as judge

N_EACH, SEED = 125, 1
FEWEST, MOST = 30, 150
QUICK = Options(n_suggestions=0)
Case = tuple[Campaign, Arm]


def series(sets: Sequence[Measured]) -> list[Series[Case]]:
    draws: dict[str, Callable[[int], Case]] = {
        measured.name: partial(drawn_subset, measured) for measured in sets
    }
    draws["simulated"] = drawn_simulated
    return [
        Series(f"subsets: {name}", draw, outcome_of, N_EACH, batch=5)
        for name, draw in draws.items()
    ]


def drawn_subset(measured: Measured, seed: int) -> Case:
    rng = np.random.default_rng([SEED, seed])
    n_poses = int(rng.integers(FEWEST, MOST + 1))
    everything = len(measured.angles_rad)
    rows = np.zeros(everything, dtype=bool)
    rows[rng.choice(everything, min(n_poses, everything), replace=False)] = True
    with tempfile.TemporaryDirectory() as folder:
        arm = read_arm(make_arm(measured, Path(folder)))
        used = measured.write(Path(folder) / "used", rows)
        return read_campaign(used, [joint.name for joint in arm.joints]), arm


def drawn_simulated(seed: int) -> Case:
    rng = np.random.default_rng([SEED, seed])
    n_poses = int(rng.integers(FEWEST, MOST + 1))
    noise = Noise(float(rng.uniform(1e-5, 3e-4)), float(rng.uniform(0.01, 0.3)))
    travel_rad = float(rng.uniform(0.2, 1.5))
    campaign = tracked(int(rng.integers(1 << 31)), n_poses, travel_rad, noise)
    return replace(campaign, encoder_rad=None, contact_mm=None), arm_value(DESIGN)


def outcome_of(case: Case) -> Line:
    """Identify; return in words: converged, or the error."""
    campaign, arm = case
    n_poses = len(campaign.poses)
    try:
        result = identify(campaign, arm, QUICK)
    except IdentificationError as error:
        return {"n_poses": n_poses, "outcome": f"refused: {error}"}
    words = " ".join(judge(result).outcome.sentences)
    if "units" in words:
        outcome = f"false units: {words}"
    else:
        outcome = "converged" if result.converged else f"not converged: {words}"
    return {"n_poses": n_poses, "outcome": outcome, "is_wrong": "units" in words}


def report(lines: Sequence[Line]) -> list[str]:
    counts: dict[str, Counter[str]] = {}
    text = []
    for line in lines:
        word = line["outcome"].partition(":")[0]
        counts.setdefault(line["scenario"], Counter())[word] += 1
        if word != "converged":
            where = f"{line['scenario']}, {line['seed']}, {line['n_poses']} poses"
            text.append(f"{where}: {line['outcome']}")
    counts["all"] = sum(counts.values(), Counter())
    for name, count in counts.items():
        text.append(
            f"{name}: {', '.join(f'{n} {outcome}' for outcome, n in count.items())}"
        )
    return text
