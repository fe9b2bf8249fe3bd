"""Where an adjustment begins: artefacts and mountings, signs and zeros, blunders.

Artefacts and mountings follow in closed form from an arm.

A coarse start: which zeros of the arm file are wrong, if the design fits badly.

The tool, where it is free, is fitted before a design counts as bad. Then the zeros
that are not held by wish are adjusted with it to a few hundred poses, from many
starts; contacts count with a noise of centimetres, so that everything smaller does
not matter. The best start is the one with the smallest median misclosure, which a few
blunders do not move.

Signs of encoders are tried before zeros: an axis that points the other way is a joint
that is counted the other way. The fewest that make the design fit are taken.

A robust start against blunders: iteratively reweighted least squares.

Weights fall with the square of a pose's whitened misclosure beyond a few robust
standard deviations, until the poses that contradict the others hardly count.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.lab.adjustment.noise import Noise
from traverse.lab.adjustment.parameters import ArmValues, Parameters
from traverse.lab.adjustment.prepare import Options, Problem, masked
from traverse.lab.adjustment.problem import Network, State
from traverse.lab.adjustment.solve import adjust
from traverse.lab.campaign.poses import evenly

# A design that fits better than this needs no search.
_GOOD_ENOUGH_MM = 20.0
# A new start must fit this much better than the design.
_GAIN = 3.0
_MOST_POSES = 240
_LARGEST_OFFSET_RAD = 1.2
_COARSE_MM = 10.0
_COARSE_RAD = 0.05
_SEED = 1


def _with_tools_fitted(problem: Problem) -> ArmValues:
    """Begin where the vectors of free tools fit to the arm as given.

    Else a tool far from the probe would look like as many blunders.
    """
    network, design = _coarse_network(problem), problem.design
    if not np.any(network.parameters.free[network.parameters.of_tools]):
        return design
    fitted = adjust(network, network.start(design), design, None, 12).state
    return replace(design, tools_mm=fitted.arm.tools_mm)


# Signs are tried where the design fits worse than this; at most so many are wrong.
_LEAST_WRONG_MM = 2.0
_MOST_SIGNS = 3
# An arm near its design: iterations to find it, what is left of its misfit, and how
# many plausible deviations a parameter may be off.
_FEW_ITERATIONS = 6
_EXPLAINED = 0.1
_PLAUSIBLE = 8.0
# Random starts of other zeros, and the best of them that are adjusted: of a design, and
# of one with a sign reversed.
_STARTS = (60, 20)
_STARTS_OF_A_SIGN = (20, 3)


@dataclass(frozen=True, slots=True, eq=False)
class StartingValues:
    """Where an adjustment begins.

    Attributes:
        design: As given, with the reversed joints.
        arm: With other zeros, where these fit much better; else the design.
        reversed_joints: Joints that turn the other way than the design says.
    """

    design: ArmValues
    arm: ArmValues
    reversed_joints: tuple[int, ...]


def find_starting_values(problem: Problem, options: Options) -> StartingValues:
    """Find where an adjustment begins: tools, signs, and zeros, as the options say."""
    design = _with_tools_fitted(problem)
    if not options.coarse_start:
        return StartingValues(design, design, ())
    return _coarse_start(replace(problem, design=design), options.hold)


def _coarse_start(problem: Problem, hold: Sequence[str]) -> StartingValues:
    """Find signs, zeros, and a free tool, with which an arm fits a campaign at all.

    What the patterns hold is never moved.

    Strategy: with right zeros the right signs fit at once, which costs no adjustment,
    so that all triples are tried first. Where none does, other zeros are, and in the
    end each joint reversed together with other zeros. Several joints reversed may be
    the mirror image of none, which fits as well: fewer are tried first, and the first
    that fit are taken.
    """
    design, parameters = problem.design, problem.parameters
    network = _coarse_network(problem)
    before_mm = _median_mm(network, network.start(design))
    if before_mm < _LEAST_WRONG_MM:
        return StartingValues(design, design, ())
    fitted = adjust(network, network.start(design), design, None, 12).state
    before_mm = min(before_mm, _median_mm(network, fitted))
    # Effects and what a family expects are stated in the sense that a joint has.
    may_turn = parameters.effects is None and parameters.expected is None
    if may_turn:
        is_near = _is_near(network, parameters, design, before_mm)
        chosen = () if is_near else _signs(network, design, before_mm)
        if is_near or chosen:
            turned = reversed_joints(design, chosen)
            return StartingValues(turned, turned, chosen)
    n_joints = parameters.n_joints
    of_zeros = slice(4 * n_joints + 6, 5 * n_joints + 6)
    zeros = np.zeros_like(parameters.free)
    zeros[of_zeros] = True
    nothing_free = parameters.with_free(np.zeros_like(zeros))
    zeros &= ~masked(nothing_free, (), hold)
    if before_mm < _GOOD_ENOUGH_MM or not np.any(zeros):
        return StartingValues(design, design, ())
    coarse = network.parameters
    network = replace(network, parameters=coarse.with_free(coarse.free | zeros))
    best, found_mm = _best_zeros(network, design, zeros[of_zeros], _STARTS)
    if found_mm > _GOOD_ENOUGH_MM and may_turn:
        for joint in range(n_joints):
            turned = reversed_joints(design, (joint,))
            other, other_mm = _best_zeros(
                network, turned, zeros[of_zeros], _STARTS_OF_A_SIGN
            )
            if other_mm < min(found_mm / _GAIN, _GOOD_ENOUGH_MM):
                return StartingValues(turned, other.arm, (joint,))
    if found_mm * _GAIN > before_mm:
        return StartingValues(design, design, ())
    return StartingValues(design, best.arm, ())


def _is_near(
    network: Network, parameters: Parameters, design: ArmValues, before_mm: float
) -> bool:
    """Return whether a plausible arm near a design explains the misfit.

    Then its signs are right: to try all of them takes most of the time of an
    identification. Of a joint that hardly turned another sign looks like a small
    change of the arm, but like an implausible one where it would be seen.
    """
    all_free = replace(network, parameters=parameters)
    start = all_free.start(design)
    state = adjust(all_free, start, design, None, _FEW_ITERATIONS).state
    changes = parameters.coordinates(design, state.arm) / parameters.tolerances
    is_plausible = np.max(np.abs(changes), initial=0.0) < _PLAUSIBLE
    return bool(is_plausible and _median_mm(all_free, state) < _EXPLAINED * before_mm)


def _signs(network: Network, design: ArmValues, before_mm: float) -> tuple[int, ...]:
    """Find the fewest joints that, reversed, make a design fit; none where none do."""
    enough_mm = min(before_mm / _GAIN, _GOOD_ENOUGH_MM)
    for n_wrong in range(1, _MOST_SIGNS + 1):
        misfits_mm = {}
        for chosen in combinations(range(design.geometry.n_joints), n_wrong):
            turned = reversed_joints(design, chosen)
            misfits_mm[chosen] = _median_mm(network, network.start(turned))
        best = min(misfits_mm, key=lambda chosen: misfits_mm[chosen], default=())
        if best and misfits_mm[best] < enough_mm:
            return best
    return ()


def reversed_joints(design: ArmValues, joints: Sequence[int]) -> ArmValues:
    """Let joints turn the other way: axes point back, and zeros are counted so."""
    signs = np.ones(design.geometry.n_joints)
    signs[list(joints)] = -1.0
    geometry = replace(
        design.geometry,
        axes=signs[:, np.newaxis] * design.geometry.axes,
        zeros_rad=signs * design.geometry.zeros_rad,
    )
    return replace(design, geometry=geometry)


def _best_zeros(
    network: Network, design: ArmValues, free: Booleans, starts: tuple[int, int]
) -> tuple[State, float]:
    """Adjust some zeros, (n_joints,), from many starts, the best of them first.

    Returns the state with the smallest median misclosure, and that.
    """
    n_starts, n_adjusted = starts
    rng = np.random.default_rng(_SEED)
    tries = rng.uniform(-1.0, 1.0, (n_starts, len(free))) * _LARGEST_OFFSET_RAD
    tries[0] = 0.0
    tries *= free
    moved = [
        replace(design.geometry, zeros_rad=design.geometry.zeros_rad + offsets_rad)
        for offsets_rad in tries
    ]
    states = [network.start(replace(design, geometry=geometry)) for geometry in moved]
    states.sort(key=lambda state: _median_mm(network, state))
    best = network.start(design)
    best_mm = _median_mm(network, best)
    for state in [best, *states[:n_adjusted]]:
        adjusted = adjust(network, state, design, most_iterations=12).state
        found_mm = _median_mm(network, adjusted)
        if found_mm < best_mm:
            best, best_mm = adjusted, found_mm
    return best, best_mm


def _coarse_network(problem: Problem) -> Network:
    """Take a few poses of every artefact, and free what is free of the tool only."""
    campaign, parameters = problem.campaign, problem.parameters
    included = np.zeros(len(campaign.poses), dtype=np.bool_)
    each = max(_MOST_POSES // len(campaign.artefacts), 12)
    for index in range(len(campaign.artefacts)):
        mine = np.flatnonzero(campaign.poses.artefacts == index)
        included[evenly(mine, each)] = True
    n = parameters.n_joints
    # The last link, the probe's vector, those of the tools, and mountings.
    of_tools = slice(5 * n + 6, parameters.n_geometric)
    is_tool = np.zeros_like(parameters.free)
    is_tool[np.r_[4 * n - 2 : 4 * n, 4 * n + 3 : 4 * n + 6, of_tools]] = True
    coarse_mm = np.full(len(campaign.artefacts), _COARSE_MM)
    noise = Noise(np.full(n, 1e-6), coarse_mm, _COARSE_RAD)
    tool_only = parameters.with_free(parameters.free & is_tool)
    return replace(problem, parameters=tool_only).network(included, noise)


def _median_mm(network: Network, state: State) -> float:
    lengths = []
    for station, unknowns in zip(network.stations, state.unknowns, strict=True):
        of_station_mm = network.misclosures_mm(station, state.arm, unknowns)
        lengths.append(np.linalg.norm(of_station_mm, axis=1))
    return float(np.median(np.concatenate(lengths)))


_ROUNDS = 8
_STEPS_A_ROUND = 2
# Robust standard deviations at which the weight has fallen to a quarter.
_BEND = 2.5
# Poses this many robust standard deviations away begin outside.
_FAR = 5.0


def robust_state(
    network: Network, start: State, design: ArmValues
) -> tuple[State, Booleans]:
    """Find estimates that blunders hardly touch, from a network with unit weights.

    And which of the campaign's poses lie near them, (n_poses,).
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
        for rows in network.white_rows(station, state.arm, unknowns):
            squares = np.mean(rows.misclosures**2, axis=1)
            sizes[station.poses[rows.part]] = np.sqrt(squares)
    return sizes


def _scale(network: Network, sizes: Floats) -> float:
    return max(float(np.median(sizes[network.poses])) / 0.8, 1e-12)
