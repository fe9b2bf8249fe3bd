"""A robust start against blunders: iteratively reweighted least squares.

Weights fall with the square of a pose's whitened misclosure beyond a few robust
standard deviations, until the poses that contradict the others hardly count.
"""

from dataclasses import replace

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.lab.identification.equations.network import Network, State
from traverse.lab.identification.equations.parameters import ArmValues
from traverse.lab.identification.equations.station_equations import white_rows
from traverse.lab.identification.solve.adjustment import adjust

_ROUNDS = 8
_STEPS_A_ROUND = 2
# Robust standard deviations at which the weight has fallen to a quarter.
_BEND = 2.5
# Poses this many robust standard deviations away begin outside.
_FAR = 5.0


def robust_state(
    network: Network, start: State, design: ArmValues
) -> tuple[State, Booleans]:
    """Find estimates that blunders hardly touch.

    Args:
        network: With unit weights.
        start: Where to begin.
        design: Where undetermined directions are held.

    Returns:
        The state, and which of the campaign's poses lie near it, (n_poses,).
    """
    state = start
    sizes = _sizes(network, state)
    for _ in range(_ROUNDS):
        scale = _scale(network, sizes)
        weights = (1.0 + (sizes / (_BEND * scale)) ** 2) ** -2.0
        weighted = replace(network, weights=np.maximum(weights, 1e-12))
        state = adjust(weighted, state, design, None, _STEPS_A_ROUND).state
        sizes = _sizes(network, state)
    return state, sizes <= _FAR * _scale(network, sizes)


def _sizes(network: Network, state: State) -> Floats:
    """Compute root mean squares of whitened misclosures; zero for others."""
    sizes = np.zeros(len(network.campaign.poses))
    for station, unknowns in zip(network.stations, state.unknowns, strict=True):
        for rows in white_rows(network, station, state.arm, unknowns):
            squares = np.mean(rows.misclosures**2, axis=1)
            sizes[station.poses[rows.part]] = np.sqrt(squares)
    return sizes


def _scale(network: Network, sizes: Floats) -> float:
    poses = np.concatenate([station.poses for station in network.stations])
    return max(float(np.median(sizes[poses])) / 0.8, 1e-12)
