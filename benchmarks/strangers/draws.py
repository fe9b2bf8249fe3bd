"""`python -m benchmarks.strangers.draws DIR [--n 12]`: is a difference chance?

The sets of docs/strangers.md with other poses used and kept aside: the other thirds of
a gauge's places, and of the tracker's two series 800 random postures of C instead of
the first, judged by all of B. Traverse beside plain least squares, as in the table.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.strangers import plain
from benchmarks.strangers.__main__ import distances_mm, figures, nominal_and_campaign
from benchmarks.strangers.sets import Measured, read_sets
from traverse.arrays import Floats
from traverse.lab.identification.identify import identify

SEED = 5
N_USED = 800


def main() -> None:
    """Print a line for each choice, and what they have in common for the series."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="with the sets")
    parser.add_argument("--n", type=int, default=12, help="choices of the series")
    asked = parser.parse_args()
    sets = {measured.name: measured for measured in read_sets(asked.folder)}
    for measured in sets.values():
        if measured.places_mm is None:
            for chosen in other_places(measured):
                both(chosen)
    if {"ipa-ur10, C", "ipa-ur10, C on B"} <= sets.keys():
        within, across = sets["ipa-ur10, C"], sets["ipa-ur10, C on B"]
        found = [both(chosen) for chosen in other_postures(within, across, asked.n)]
        each = np.array(
            [[f(mm) for mm in pair for f in (np.mean, np.max)] for pair in found]
        )
        print("all: scipy mean, worst, Traverse mean, worst; their standard deviations")
        print(np.round(each.mean(axis=0), 3), np.round(each.std(axis=0, ddof=1), 3))


def both(measured: Measured) -> tuple[Floats, Floats]:
    """Fit one choice in both ways and print it; distances [mm] of poses kept aside."""
    arm, given = nominal_and_campaign(measured)
    tool = plain.fitted(plain.chain_of(arm), measured, tool_only=True)
    rival = plain.fitted(tool, measured)
    theirs = plain.held_out_mm(rival.places_mm(measured.angles_rad), measured)
    found = identify(given, arm)
    mine = distances_mm(measured, found.arm)
    words = f"{measured.name}, {measured.held_by}: scipy {figures(theirs)}"
    print(f"{words}; Traverse {figures(mine)}, {len(found.excluded)} out", flush=True)
    return theirs, mine


def other_places(measured: Measured) -> Iterator[Measured]:
    """Keep every third place of a gauge aside, beginning with each of three."""
    places = sorted({place for place, _ in measured.sockets})
    for first in range(3):
        kept = places[first::3]
        is_kept = np.array([place in kept for place, _ in measured.sockets])
        yield replace(measured, is_kept=is_kept, held_by=", ".join(kept))


def other_postures(within: Measured, across: Measured, n: int) -> Iterator[Measured]:
    """Use random postures of the first series, and keep all of the second aside."""
    rng = np.random.default_rng(SEED)
    aside = across.is_kept
    if within.places_mm is None or across.places_mm is None:
        return
    for number in range(1, n + 1):
        used = rng.choice(len(within.angles_rad), N_USED, replace=False)
        angles_rad = np.vstack([within.angles_rad[used], across.angles_rad[aside]])
        places_mm = np.vstack([within.places_mm[used], across.places_mm[aside]])
        yield replace(
            across,
            angles_rad=angles_rad,
            places_mm=places_mm,
            sockets=[("", "")] * len(angles_rad),
            is_kept=np.arange(len(angles_rad)) >= N_USED,
            held_by=f"series B, choice {number}",
        )


if __name__ == "__main__":
    main()
