"""Other choices of the used poses: whether a difference in the table is chance.

The other thirds of a gauge's places, and of the tracker's two series 800 random
postures of C instead of the first, judged by all of B. Traverse beside plain least
squares, as in the table.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.strangers.sets import Measured
from benchmarks.strangers.table import (
    distances_mm,
    figures,
    nominal_and_campaign,
    plain_fits,
)
from benchmarks.trials.lines import Line
from benchmarks.trials.series import Series
from traverse.lab.identification.identify import identify

WITHIN, ACROSS = "ipa-ur10, C", "ipa-ur10, C on B"
SEED = 5
N_USED, N_CHOICES, N_THIRDS = 800, 12, 3


def series(sets: Sequence[Measured]) -> list[Series[Measured]]:
    by_name = {measured.name: measured for measured in sets}
    thirds = [
        Series(f"choices: {name}", partial(other_places, measured), compared, N_THIRDS)
        for name, measured in by_name.items()
        if measured.places_mm is None
    ]
    if not {WITHIN, ACROSS} <= by_name.keys():
        return thirds
    draw = partial(other_postures, by_name[WITHIN], by_name[ACROSS])
    return [*thirds, Series(f"choices: {ACROSS}", draw, compared, N_CHOICES)]


def compared(measured: Measured) -> Line:
    """Fit one choice in both ways: mean and largest distance of poses kept aside."""
    arm, campaign = nominal_and_campaign(measured)
    _, theirs_mm = plain_fits(arm, measured)
    result = identify(campaign, arm)
    mine_mm = distances_mm(measured, result.arm)
    return {
        "held_by": measured.held_by,
        "text": f"scipy {figures(theirs_mm)}; Traverse {figures(mine_mm)}, "
        f"{len(result.excluded)} out",
        "mm": [float(f(mm)) for mm in (theirs_mm, mine_mm) for f in (np.mean, np.max)],
    }


def report(lines: Sequence[Line]) -> list[str]:
    """List the choices, and mean and spread over those across series."""
    text = [f"{line['scenario']}, {line['held_by']}: {line['text']}" for line in lines]
    each = np.array([line["mm"] for line in lines if line["scenario"].endswith(ACROSS)])
    if len(each) > 1:
        text += [
            "all: scipy mean, worst, Traverse mean, worst; their standard deviations",
            f"{np.round(each.mean(axis=0), 3)} {np.round(each.std(axis=0, ddof=1), 3)}",
        ]
    return text


def other_places(measured: Measured, first: int) -> Measured:
    """Keep every third place of a gauge aside, beginning with one of three."""
    places = sorted({place for place, _ in measured.sockets})
    kept = places[first::N_THIRDS]
    is_kept = np.array([place in kept for place, _ in measured.sockets])
    return replace(measured, is_kept=is_kept, held_by=", ".join(kept))


def other_postures(within: Measured, across: Measured, number: int) -> Measured:
    """Use random postures of the first series, and keep all of the second aside."""
    if within.places_mm is None or across.places_mm is None:
        raise ValueError("both series are of a tracker")
    # One stream of choices, of which this is the next after so many.
    rng = np.random.default_rng(SEED)
    draws = [
        rng.choice(len(within.angles_rad), N_USED, replace=False)
        for _ in range(number + 1)
    ]
    used, aside = draws[-1], across.is_kept
    angles_rad = np.vstack([within.angles_rad[used], across.angles_rad[aside]])
    return replace(
        across,
        angles_rad=angles_rad,
        places_mm=np.vstack([within.places_mm[used], across.places_mm[aside]]),
        sockets=[("", "")] * len(angles_rad),
        is_kept=np.arange(len(angles_rad)) >= N_USED,
        held_by=f"series B, choice {number + 1}",
    )
