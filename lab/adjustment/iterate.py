"""The rounds of an identification: adjust, test, improve the noise, and again."""

from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Booleans
from traverse.lab.adjustment.noise import (
    Noise,
    a_priori_noise,
    better_noise,
    variance_model,
)
from traverse.lab.adjustment.parameters import ArmValues
from traverse.lab.adjustment.prepare import Options
from traverse.lab.adjustment.problem import Network, stations
from traverse.lab.adjustment.snooping import (
    PoseStatistics,
    pose_statistics,
    robust_scale,
    snoop,
)
from traverse.lab.adjustment.solve import MOST_ITERATIONS, Adjustment, adjust
from traverse.lab.adjustment.starting_values import robust_state, start_state
from traverse.lab.outcomes.progress import Iteration, Progress

_MOST_ROUNDS = 40
# Poses that take part the same for this many times go round in a circle.
_A_CIRCLE = 3
# Adjustments that did not converge, before no more are tried.
_MOST_BAD = 5
# Standard deviations that change by less than this are settled.
_NOISE_SETTLED = 0.01
# A classical sigma0 this much above the robust one betrays blunders.
_BLUNDERS = 1.2


@dataclass(frozen=True, slots=True, eq=False)
class IteratedAdjustment:
    """Where neither the poses that take part nor the noise changed any more.

    Attributes:
        statistics: Of all poses; of those that took no part: as predicted.
        included: Poses that took part, (n_poses,).
        alternating: Excluded because they contradict the others only while they take
            part, (n_poses,).
        critical: |w| above which a pose is excluded.
        noise_estimated: Whether any noise was; with little redundancy it stays as
            assumed.
    """

    adjustment: Adjustment
    statistics: PoseStatistics
    included: Booleans
    alternating: Booleans
    critical: float
    iterations: tuple[Iteration, ...]
    noise_estimated: bool


def iterate(
    network: Network,
    design: ArmValues,
    options: Options,
    radius_mm: float,
    *,
    first: Booleans | None = None,
    staying: Booleans | None = None,
    progress: Progress | None = None,
    most_iterations: int = MOST_ITERATIONS,
) -> IteratedAdjustment:
    """Adjust until neither the poses that take part nor the noise change.

    Poses of the network's stations may take part; the first ones do to begin with
    (default all), the staying ones whatever they say (default none), (n_poses,) each.
    """
    campaign = network.campaign
    # From where the family has its arms: there are undetermined directions held, too.
    design = network.parameters.as_expected(design)
    if network.parameters.mounted:
        # Wherever an instrument's probe is mounted is as plausible as anywhere else.
        design = start_state(network, design).arm
    variances = options.variances or variance_model(campaign)
    iterations: list[Iteration] = []

    def without(
        included: Booleans, arm: ArmValues, noise: Noise | None = None
    ) -> tuple[Adjustment, PoseStatistics]:
        chosen = stations(campaign, radius_mm, included)
        part = replace(network, stations=chosen, noise=noise or network.noise)
        found = adjust(part, start_state(part, arm), design, progress, most_iterations)
        iterations.extend(found.iterations)
        return found, pose_statistics(found)

    eligible = network.included
    staying = np.zeros_like(eligible) if staying is None else eligible & staying
    included = eligible if first is None else eligible & first | staying
    adjustment, found = without(included, design)
    if options.snooping and (
        not adjustment.converged or adjustment.sigma0 > _BLUNDERS * robust_scale(found)
    ):
        state = start_state(network, design)
        state, included = robust_state(network, state, design)
        included = included & eligible | staying
        adjustment, found = without(included, state.arm)
    critical = float("inf")
    visited: list[Booleans] = []
    alternating, n_bad = np.zeros_like(eligible), 0
    for _ in range(_MOST_ROUNDS):
        noise, change = better_noise(
            campaign, adjustment.network.noise, found.variances, variances
        )
        n_changed, going_on = 0, included
        if options.snooping:
            following, critical = snoop(
                adjustment,
                found,
                included,
                eligible,
                family_level=options.family_level,
                noise_known=not variances.estimates,
                radius_mm=radius_mm,
            )
            going_on = following | staying
            n_changed = int(np.count_nonzero(going_on != included))
        n_bad += not adjustment.converged
        if (change < _NOISE_SETTLED and n_changed == 0) or n_bad == _MOST_BAD:
            break
        circle = _circle(visited, going_on) if n_changed else []
        if circle:
            # Out for good: what remains cannot alternate by them.
            alternating |= np.any(circle, axis=0) & ~np.all(circle, axis=0)
            eligible = eligible & ~alternating
            visited, going_on = [], going_on & eligible | staying
        visited.append(going_on)
        included = going_on
        adjustment, found = without(included, adjustment.state.arm, noise)
    if not np.all(included):
        others = stations(campaign, radius_mm, ~included)
        found.fill(pose_statistics(adjustment, others), ~included)
    return IteratedAdjustment(
        adjustment,
        found,
        included,
        alternating,
        critical,
        tuple(iterations),
        variances.estimates and _is_estimated(adjustment.network),
    )


def _is_estimated(network: Network) -> bool:
    """Return whether any standard deviation is not as stated or assumed."""
    noise, given = network.noise, a_priori_noise(network.campaign)
    return not (
        np.array_equal(noise.encoder_rad, given.encoder_rad)
        and np.array_equal(noise.contact_mm, given.contact_mm)
        and noise.orientation_rad == given.orientation_rad
    )


def _circle(visited: list[Booleans], included: Booleans) -> list[Booleans]:
    """Find the recurring selections of poses; none without a cycle."""
    same = [at for at, one in enumerate(visited) if np.array_equal(one, included)]
    return [] if len(same) < _A_CIRCLE - 1 else visited[same[-1] :]
