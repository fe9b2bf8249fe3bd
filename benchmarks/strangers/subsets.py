"""`python -m benchmarks.strangers.subsets DIR [--n 1000] [--seed 1]`: does it converge?

Draws random subsets of poses, by turns from one of the sets of docs/strangers.md and
from a simulated arm that a tracker follows, identifies each, and counts what happened.
None of these has wrong units: a report that says so is false.
"""

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.strangers.sets import Measured, make_arm, read_sets
from tests.lab.identification.test_strangers import DESIGN, tracked
from tests.lab.simulated import Noise, arm_value
from traverse.kinematics.arm_file.arm import Arm, read_arm
from traverse.lab.campaign.campaign import Campaign, read_campaign
from traverse.lab.identification.identify import (
    IdentificationError,
    Options,
    identify,
)
from traverse.lab.identification.report.page import WORDS

FEWEST, MOST = 30, 150
QUICK = Options(n_suggestions=0)


def main() -> None:
    """Print every subset that did not converge, and a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="with the sets")
    parser.add_argument("--n", type=int, default=1000, help="subsets")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    counts: dict[str, Counter[str]] = {}
    sets = list(read_sets(asked.folder))
    for number, (name, campaign, arm) in enumerate(
        drawn(sets, asked.n, np.random.default_rng(asked.seed))
    ):
        outcome = outcome_of(campaign, arm)
        counts.setdefault(name, Counter())[outcome.partition(":")[0]] += 1
        if outcome != "converged":
            text = f"{number} {name}, {len(campaign.poses)} poses: {outcome}"
            print(text, flush=True)
    for name, one in counts.items():
        print(f"{name}: {', '.join(f'{n} {what}' for what, n in one.items())}")
    total = sum(counts.values(), Counter[str]())
    print(f"all: {', '.join(f'{n} {what}' for what, n in total.items())}")


def drawn(
    sets: Sequence[Measured], n: int, rng: np.random.Generator
) -> Iterator[tuple[str, Campaign, Arm]]:
    """Random subsets, each with the nominal arm."""
    for number in range(n):
        n_poses = int(rng.integers(FEWEST, MOST + 1))
        if number % (len(sets) + 1) == len(sets):
            noise = Noise(float(rng.uniform(1e-5, 3e-4)), float(rng.uniform(0.01, 0.3)))
            travel_rad = float(rng.uniform(0.2, 1.5))
            campaign = tracked(int(rng.integers(1 << 31)), n_poses, travel_rad, noise)
            free = replace(campaign, encoder_rad=None, contact_mm=None)
            yield "simulated", free, arm_value(DESIGN)
            continue
        measured = sets[number % (len(sets) + 1)]
        everything = len(measured.angles_rad)
        rows = np.zeros(everything, dtype=bool)
        chosen = rng.choice(everything, min(n_poses, everything), replace=False)
        rows[chosen] = True
        with tempfile.TemporaryDirectory() as folder:
            arm = read_arm(make_arm(measured, Path(folder)))
            names = [joint.name for joint in arm.joints]
            used = measured.write(Path(folder) / "used", rows)
            campaign = read_campaign(used, names)
        yield measured.name, campaign, arm


def outcome_of(campaign: Campaign, arm: Arm) -> str:
    """In words: converged, or what was said instead."""
    try:
        result = identify(campaign, arm, QUICK)
    except IdentificationError as error:
        return f"refused: {error}"
    words = " ".join(WORDS.lines("sigma0", result))
    if "units" in words:
        return f"false units: {words}"
    return "converged" if result.converged else f"not converged: {words}"


if __name__ == "__main__":
    main()
