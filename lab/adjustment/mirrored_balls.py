"""Balls with few touches, on the wrong side of which an adjustment may end.

Strategy: three touches lie on two spheres of one radius, and a few more nearly so. An
arm that is millimetres off its design chooses between them by chance, and the iteration
never leaves the wrong one: what is left then looks like noise, like a wrong certificate
or like a missing effect. So where an adjustment explains badly what was measured, balls
are put to the other side, one after another, as long as that explains much more.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from traverse.lab.adjustment.adjusted import Adjustment
from traverse.lab.adjustment.parameters import ArmValues
from traverse.lab.adjustment.problem import State
from traverse.lab.adjustment.solve import adjust

# Standard deviations of a mean square above which balls are tried on the other side.
_SUSPICIOUS = 3.0
# The sum of squares falls to this part of it, or by this much, with the right side.
_MUCH_LESS = 0.9
_LEAST_GAIN = 10.0
# Misclosures of less than about a ball's radius are left by its being on the wrong
# side; more, by an arm file that does not fit at all.
_MOST_LEFT_MM = 15.0
# Of an adjustment with all its rounds.
MOST_TRIALS = 24
# A wrong hypothesis creeps, a right one is there by then.
_MOST_ITERATIONS = 25


def with_balls_on_the_right_side(
    adjustment: Adjustment, design: ArmValues, most_trials: int
) -> tuple[Adjustment, int]:
    """Adjust again with mirrored balls, as long as that explains much more.

    Returns the adjustment and the number of trials.
    """
    n_trials = 0
    is_better = True
    while is_better and _is_suspicious(adjustment):
        is_better = False
        for state in _mirrored(adjustment):
            if n_trials == most_trials:
                break
            n_trials += 1
            trial = adjust(
                adjustment.network, state, design, most_iterations=_MOST_ITERATIONS
            )
            if _explains_more(trial, adjustment):
                adjustment, is_better = trial, True
                break
    return adjustment, n_trials


def _is_suspicious(adjustment: Adjustment) -> bool:
    if adjustment.system.rms_mm > _MOST_LEFT_MM:
        return False
    limit = 1.0 + _SUSPICIOUS * np.sqrt(2.0 / max(adjustment.redundancy, 1))
    return not adjustment.converged or bool(adjustment.sigma0**2 > limit)


def _explains_more(trial: Adjustment, adjustment: Adjustment) -> bool:
    if not trial.converged:
        return False
    before = adjustment.system.sum_of_squares
    most = min(_MUCH_LESS * before, before - _LEAST_GAIN)
    return not adjustment.converged or trial.system.sum_of_squares < most


def _mirrored(adjustment: Adjustment) -> Iterator[State]:
    """Yield the state with one artefact mirrored, each in turn."""
    network, state = adjustment.network, adjustment.state
    for index, station in enumerate(network.stations):
        images = station.artefact.mirror_images(
            state.unknowns[index],
            network.centres_mm(station, state.arm),
            station.touches,
        )
        for image in images:
            unknowns = (*state.unknowns[:index], image, *state.unknowns[index + 1 :])
            yield replace(state, unknowns=unknowns)
