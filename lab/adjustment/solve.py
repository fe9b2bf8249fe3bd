"""General least squares: iterated Gauss-Newton on condition equations.

Condition equations w(l, p, z) = 0 with noisy readings and contacts l, the arm's
parameters p and the stations' unknowns z are linearised at the corrected l (once the
start is good: at the observed ones before); with B = dw/dl and Q the dispersion of l
the steps minimise

    sum over poses (w + A_p dp + A_z dz)^T (B Q B^T)^-1 (w + A_p dp + A_z dz)

Per station z is eliminated by QR; what is left is stacked and split by rank. A step
that would raise the weighted sum of squares is damped as by Levenberg and Marquardt,
weak directions first. Damping only chooses the way: at the end there is none.
"""

from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats
from traverse.lab.adjustment.adjusted import Adjustment, design_spread
from traverse.lab.adjustment.parameters import ArmValues
from traverse.lab.adjustment.problem import Network, State
from traverse.lab.adjustment.system import (
    RankDecision,
    System,
    decide_rank,
    linearise,
    sum_of_squares,
)
from traverse.lab.outcomes.adjustment import Iteration, Progress

MOST_ITERATIONS = 200
# Of a step: more and more damped up to a square of singular values, then halved.
_MOST_TRIALS = 24
_MOST_DAMPING = 1e7
# Of a whitened step. It is taken, and what is left after it is a thousandth of it or
# less: far below a picometre. Where convergence is slow a hundredth of a standard
# deviation is enough.
_CONVERGED = 1e-5
_SLOW_AFTER = 50
_CONVERGED_SLOWLY = 1e-2
# A sum of squares may rise by this much of itself from rounding.
_ROUNDING = 1e-9
# And by what columns of effects leave out, this part of them: at deflections of some
# milliradians the sum of squares is lowest a little beside where they point.
_LEFT_OUT = 1e-3
# Mean square of whitened misclosures below which observations are corrected.
_GOOD_START = 100.0
# After a step this small the rank stays. After this many it changes only where a
# singular value is this much above or below the limit: it does not alternate.
_NEAR = 1.0
_RANK_SETTLES_AT = 12
_CLEARLY = 2.0
# Mean square of residuals above which they determine the uncertainty, not the noise.
_LARGE = 2.25


def adjust(
    network: Network,
    start: State,
    design: ArmValues,
    progress: Progress | None = None,
    most_iterations: int = MOST_ITERATIONS,
) -> Adjustment:
    """Adjust a network; undetermined directions are held where the design has them."""
    parameters = network.parameters
    state = start
    system = linearise(network, state)
    iterations: list[Iteration] = []
    n_determined: int | None = None
    converged, corrected, settled = False, False, False
    trial, back = _Trial(), 1.0
    step = last = np.zeros(parameters.n_free)
    while not converged and len(iterations) < most_iterations:
        number = len(iterations) + 1
        to_design = parameters.coordinates(design, state.arm)[parameters.free]
        parts = _split(network, state, system, to_design, n_determined, settled=settled)
        step, held = parts.step(to_design)
        held = held / parts.tolerances
        # Along a curved undetermined direction the way back to the design overshoots.
        back *= 0.5 if held @ last < -0.25 * (last @ last) else 1.0
        last = held
        state, size, fraction, trial = _stepped(
            network, state, system, parts, back * to_design, first=trial
        )
        small = _CONVERGED if number <= _SLOW_AFTER else _CONVERGED_SLOWLY
        converged = size < small and fraction > 0.0
        if size < _NEAR:
            settled = True
        if settled or number >= _RANK_SETTLES_AT:
            n_determined = parts.n_determined
        total, rms_mm = system.sum_of_squares, system.rms_mm
        iteration = Iteration(number, total, rms_mm, size, fraction, parts.n_determined)
        iterations.append(iteration)
        if progress is not None:
            progress(iteration)
        if converged or fraction == 0.0:
            # So small a step leaves the system as it is.
            break
        # Once they are, they stay: a misfit at the limit would else alternate.
        corrected |= system.sum_of_squares < _GOOD_START * network.n_rows
        if corrected:
            state = replace(state, corrections=system.corrections)
        system = linearise(network, state)
    to_design = parameters.coordinates(design, state.arm)[parameters.free]
    parts = _split(network, state, system, to_design, n_determined, settled=True)
    # Nonsense determines nothing, so that its steps are small.
    some = parts.n_determined > 0 or parameters.n_free == 0
    converged &= some or system.sum_of_squares < _GOOD_START * network.n_rows
    return Adjustment(
        network=network,
        state=state,
        system=system,
        split=parts,
        iterations=tuple(iterations),
        converged=converged,
        redundancy=_redundancy(network, state, system, parts),
        last_step=step,
    )


def _split(
    network: Network,
    state: State,
    system: System,
    to_design: Floats,
    n_before: int | None,
    *,
    settled: bool,
) -> RankDecision:
    """Decide the rank; residuals larger than the noise say less than it claims.

    A direction counts where its data say more than the design does. How much that is
    worth is seen where the data are strong: an arm that is several times as far from
    its design as is plausible is so in the other directions, too.

    To the design leads a step, (n_free,). Once the number of directions that counted
    before is given, only a clear change of it counts; settled, it is final.
    """
    scale = network.undetermined_scale(state.arm)
    tolerances = network.parameters.free_tolerances
    if settled and n_before is not None:
        return decide_rank(system.upper, tolerances, scale, n_before)
    parts = decide_rank(system.upper, tolerances, scale)
    explained = float(np.sum(parts.right[: parts.n_determined] ** 2))
    explained += sum(
        float(np.sum(elimination.right**2)) for elimination in system.eliminations
    )
    redundancy = max(_redundancy(network, state, system, parts), 1)
    left = max(system.sum_of_squares - explained, 0.0) / redundancy
    limit = float(np.sqrt(left)) if left > _LARGE else 1.0
    limit /= design_spread(parts, to_design)
    n_determined = int(np.count_nonzero(parts.values > limit))
    if n_before is not None:
        least = int(np.count_nonzero(parts.values > limit * _CLEARLY))
        most = int(np.count_nonzero(parts.values > limit / _CLEARLY))
        n_determined = min(max(n_before, least), most)
    return replace(parts, n_determined=n_determined)


def _modelled(system: System, step: Floats) -> float:
    """Predict what the arm's part of the sum of squares becomes by a step."""
    left = system.upper[:, :-1] @ step - system.upper[:, -1]
    return float(left @ left)


@dataclass(frozen=True, slots=True)
class _Trial:
    """How a step is shortened: damped, and of what is left a fraction.

    Strategy: damping leaves the steps of the unknowns as they are. Where these are too
    long, those of the next iteration are, too: it does not begin with the whole step.
    """

    damping: float = 0.0
    fraction: float = 1.0


def _stepped(
    network: Network,
    state: State,
    system: System,
    parts: RankDecision,
    to_design: Floats,
    *,
    first: _Trial,
) -> tuple[State, float, float, _Trial]:
    """Take as much of a step as does not raise the sum of squares.

    Returns the state, the length of the whole step in standard deviations, the fraction
    taken, what to begin with next time.
    """
    size = _length(system, parts.step(to_design)[0])
    damping, fraction = first.damping, first.fraction
    for _ in range(_MOST_TRIALS):
        step, held = parts.step(to_design, damping)
        # A smaller arm has smaller misclosures: the way back to the design's scale may
        # go uphill, by as much as the linear model says.
        cost = _modelled(system, step) - _modelled(system, step - held)
        limit = system.sum_of_squares * (1.0 + _ROUNDING) + 1.5 * max(cost, 0.0)
        limit += _LEFT_OUT * size * float(np.sqrt(system.sum_of_squares))
        unknowns = tuple(
            station.artefact.moved(values, fraction * elimination.step(step))
            for station, values, elimination in zip(
                network.stations, state.unknowns, system.eliminations, strict=True
            )
        )
        arm = network.parameters.moved(state.arm, fraction * step)
        moved = replace(state, arm=arm, unknowns=unknowns)
        if size < _CONVERGED or sum_of_squares(network, moved, system) <= limit:
            part_of_step = fraction if damping == 0.0 else _length(system, step) / size
            # Smallest singular values are about one: less damping does nothing.
            less = damping / 16.0 if damping > 16.0 else 0.0
            return moved, size, part_of_step, _Trial(less, min(4.0 * fraction, 1.0))
        if damping >= _MOST_DAMPING or not len(step):
            fraction *= 0.5
        else:
            damping = max(4.0 * damping, 1.0)
    return state, size, 0.0, _Trial(damping, fraction)


def _length(system: System, step: Floats) -> float:
    """Compute the length of a step, unknowns included, in standard deviations."""
    size = float(np.linalg.norm(system.upper[:, :-1] @ step))
    for elimination in system.eliminations:
        size = float(
            np.hypot(size, np.linalg.norm(elimination.right - elimination.left @ step))
        )
    return size


def _redundancy(
    network: Network, state: State, system: System, parts: RankDecision
) -> int:
    n_certified = sum(
        len(network.certified(station, state.arm, unknowns))
        for station, unknowns in zip(network.stations, state.unknowns, strict=True)
    )
    n_known = n_certified + len(network.parameters.expectations(state.arm))
    determined = sum(len(elimination.right) for elimination in system.eliminations)
    return network.n_rows + n_known - determined - parts.n_determined
