"""General least squares: iterated Gauss-Newton on condition equations.

Condition equations w(l, p, z) = 0 with noisy readings and contacts l, the arm's
parameters p and the stations' unknowns z are linearised at the corrected l (once the
start is good: at the observed ones before); with B = dw/dl and Q the dispersion of l
the steps minimise

    sum over poses (w + A_p dp + A_z dz)^T (B Q B^T)^-1 (w + A_p dp + A_z dz)

Per station z is eliminated by QR; what is left is stacked and split by rank. A step
is halved until it does not raise the weighted sum of squares.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats
from traverse.lab.identification.equations.datum import scale_direction
from traverse.lab.identification.equations.network import Network, State, has_length
from traverse.lab.identification.equations.parameters import ArmValues
from traverse.lab.identification.solve.rank import RankDecision, split
from traverse.lab.identification.solve.system import (
    System,
    certified,
    linearise,
    sum_of_squares,
)

_MOST_ITERATIONS = 50
_MOST_HALVINGS = 12
# Of a whitened step. It is taken, and what is left after it is a thousandth of it or
# less: far below a picometre.
_CONVERGED = 1e-5
# A sum of squares may rise by this much of itself from rounding.
_ROUNDING = 1e-9
# Mean square of whitened misclosures below which observations are corrected.
_GOOD_START = 100.0
# After a step this small, or this many, the rank stays: it cannot alternate.
_NEAR = 1.0
_RANK_SETTLES_AT = 12


@dataclass(frozen=True, slots=True, eq=False)
class Iteration:
    """How far an adjustment has come.

    Attributes:
        number: From 1.
        sum_of_squares: Weighted, before the step.
        rms_mm: Root mean square of all scalar misclosures, before the step.
        step: Length of the whitened step, in standard deviations.
        fraction: Of the step that was taken.
        n_determined: Directions of the arm's parameters that count.
    """

    number: int
    sum_of_squares: float
    rms_mm: float
    step: float
    fraction: float
    n_determined: int


Progress = Callable[[Iteration], None]


@dataclass(frozen=True, slots=True, eq=False)
class Adjustment:
    """The result of one adjustment.

    Attributes:
        network: What was adjusted.
        state: The estimates.
        system: Linearised there.
        split: Of the arm's parameters there.
        iterations: What happened.
        converged: Whether the last step was negligible.
        redundancy: Equations and certificates less determined unknowns.
    """

    network: Network
    state: State
    system: System
    split: RankDecision
    iterations: tuple[Iteration, ...]
    converged: bool
    redundancy: int

    @property
    def sigma0(self) -> float:
        """A-posteriori standard deviation of unit weight."""
        if self.redundancy <= 0:
            return 1.0
        return float(np.sqrt(self.system.sum_of_squares / self.redundancy))


def adjust(
    network: Network,
    start: State,
    design: ArmValues,
    progress: Progress | None = None,
    most_iterations: int = _MOST_ITERATIONS,
) -> Adjustment:
    """Adjust a network.

    Args:
        network: Observations, free parameters, noise.
        start: Where to begin.
        design: Where undetermined directions are held.
        progress: Told of every iteration.
        most_iterations: Before giving up.
    """
    parameters = network.parameters
    state = start
    system = linearise(network, state)
    iterations: list[Iteration] = []
    n_determined: int | None = None
    converged = False
    while not converged and len(iterations) < most_iterations:
        number = len(iterations) + 1
        parts = _split(network, state, system, n_determined)
        to_design = parameters.coordinates(design, state.arm)[parameters.free]
        step, held = parts.step(to_design)
        # A smaller arm has smaller misclosures: the way back to the design's scale may
        # go uphill, by as much as the linear model says.
        cost = _modelled(system, step) - _modelled(system, step - held)
        state, size, fraction = _stepped(network, state, system, step, max(cost, 0.0))
        converged = size < _CONVERGED and fraction > 0.0
        if size < _NEAR or number >= _RANK_SETTLES_AT:
            n_determined = parts.n_determined
        found = Iteration(
            number,
            system.sum_of_squares,
            system.rms_mm,
            size,
            fraction,
            parts.n_determined,
        )
        iterations.append(found)
        if progress is not None:
            progress(found)
        if converged or fraction == 0.0:
            # So small a step leaves the system as it is.
            break
        if system.sum_of_squares < _GOOD_START * network.n_rows:
            state = replace(state, corrections=system.corrections)
        system = linearise(network, state)
    parts = _split(network, state, system, n_determined)
    return Adjustment(
        network=network,
        state=state,
        system=system,
        split=parts,
        iterations=tuple(iterations),
        converged=converged,
        redundancy=_redundancy(network, state, system, parts),
    )


def _split(
    network: Network, state: State, system: System, n_determined: int | None
) -> RankDecision:
    parameters = network.parameters
    scale = np.empty((0, parameters.n_free))
    if not has_length(network):
        scale = scale_direction(parameters, state.arm.geometry)
    return split(system.upper, parameters.free_tolerances, scale, n_determined)


def _modelled(system: System, step: Floats) -> float:
    """Predict what the arm's part of the sum of squares becomes by a step."""
    left = system.upper[:, :-1] @ step - system.upper[:, -1]
    return float(left @ left)


def _stepped(
    network: Network, state: State, system: System, step: Floats, cost: float
) -> tuple[State, float, float]:
    """Take as much of a step as does not raise the sum of squares.

    Returns:
        The state, the length of the whole step in standard deviations, the fraction.
    """
    unknown_steps = [found.step(step) for found in system.eliminations]
    whitened = system.upper[:, :-1] @ step
    size = float(np.linalg.norm(whitened))
    for found in system.eliminations:
        size = float(np.hypot(size, np.linalg.norm(found.right - found.left @ step)))
    limit = system.sum_of_squares * (1.0 + _ROUNDING) + 1.5 * cost
    fraction = 1.0
    for _ in range(_MOST_HALVINGS):
        trial = _moved(network, state, fraction * step, unknown_steps, fraction)
        if size < _CONVERGED or sum_of_squares(network, trial, system) <= limit:
            return trial, size, fraction
        fraction *= 0.5
    return state, size, 0.0


def _moved(
    network: Network,
    state: State,
    step: Floats,
    unknown_steps: list[Floats],
    fraction: float,
) -> State:
    unknowns = tuple(
        station.artefact.moved(values, fraction * unknown_step)
        for station, values, unknown_step in zip(
            network.stations, state.unknowns, unknown_steps, strict=True
        )
    )
    return replace(
        state, arm=network.parameters.moved(state.arm, step), unknowns=unknowns
    )


def _redundancy(
    network: Network, state: State, system: System, parts: RankDecision
) -> int:
    n_certified = sum(
        len(certified(network, station, state.arm, unknowns))
        for station, unknowns in zip(network.stations, state.unknowns, strict=True)
    )
    determined = sum(len(found.right) for found in system.eliminations)
    return network.n_rows + n_certified - determined - parts.n_determined
