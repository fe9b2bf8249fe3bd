"""The rounds of an identification: adjust, test, improve the noise, and again.

Data snooping: poses that contradict the others are excluded, and may return. The worst
contradict first, because one blunder makes its neighbours look bad; with many poses
several leave at a time, all those near the worst. Whoever agrees with the estimates of
the rest is taken back.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.lab.adjustment.adjusted import Adjustment
from traverse.lab.adjustment.mirrored_balls import (
    MOST_TRIALS,
    with_balls_on_the_right_side,
)
from traverse.lab.adjustment.noise import (
    Noise,
    a_priori_noise,
    better_noise,
    variance_model,
)
from traverse.lab.adjustment.parameters import ArmValues
from traverse.lab.adjustment.pose_statistics import PoseStatistics
from traverse.lab.adjustment.prepare import Options
from traverse.lab.adjustment.problem import Network
from traverse.lab.adjustment.solve import MOST_ITERATIONS, adjust
from traverse.lab.adjustment.starting_values import robust_state
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.outcomes.adjustment import Iteration, Progress
from traverse.lab.statistics.distributions import (
    normal_quantile,
    student_critical,
    tau_critical,
)
from traverse.lab.statistics.outlier_clusters import (
    ExcludedCluster,
    Line,
    find_outlier_cluster,
)

_MOST_ROUNDS = 40
# Poses that take part the same for this many times go round in a circle.
_A_CIRCLE = 3
# Adjustments that did not converge, before no more are tried.
_MOST_BAD = 5
# Standard deviations that change by less than this are settled.
_NOISE_SETTLED = 0.01
# A classical sigma0 this much above the robust one betrays blunders.
_BLUNDERS = 1.2
_N_DRAWS = 300
_MOST_CLUSTERS = 3
# A blunder may be there as well: so many times the median of the others' |w|.
_MUCH_WORSE = 4.0
# Probability of a cluster by chance, below which it is a finding about the arm: one
# that is reported at 0.001 would bring back blunders of one campaign in hundreds.
_BY_CHANCE = 1e-6


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
        design: Values that undetermined directions keep.
    """

    adjustment: Adjustment
    statistics: PoseStatistics
    included: Booleans
    alternating: Booleans
    critical: float
    iterations: tuple[Iteration, ...]
    noise_estimated: bool
    design: ArmValues

    @property
    def size(self) -> float:
        """How many times as long as in the design all links are together."""
        now, then = (
            float(np.sum(np.linalg.norm(arm.geometry.links_mm, axis=1)))
            for arm in (self.adjustment.state.arm, self.design)
        )
        return now / max(then, 1e-9)

    def contradicted_by_orientation(self) -> Booleans:
        """Find poses that were excluded, but whose position alone agrees, (n_poses,).

        None of an adjustment that excluded nobody.
        """
        agreeing = self.statistics.w_position < self.critical  # NaN: has no orientation
        excluded: Booleans = agreeing & ~self.included & ~self.alternating
        return excluded if np.isfinite(self.critical) else np.zeros_like(excluded)

    def with_clusters_back(
        self, campaign: Campaign, again: Callable[[Booleans], "IteratedAdjustment"]
    ) -> "tuple[IteratedAdjustment, tuple[ExcludedCluster, ...]]":
        """Take excluded poses back that lie together in the range of a joint.

        Again adjusts with poses that stay, (n_poses,). Returns the last adjustment, and
        the clusters.

        Strategy: a blunder may be anywhere. Where excluded poses gather in a range of a
        joint's angle, the arm does something there that its model lacks: they tell more
        about it than all others, and without them the arm would be fitted to where it
        is easy. They take part again. Those that gather on one artefact or in time may
        tell of a socket that moved: they stay out. So do the few that chance brings
        together: taking blunders back costs more than leaving such poses out.
        """
        poses = campaign.poses
        lines: list[Line] = [
            (f"{name}_rad", name, poses.angles_rad[:, joint])
            for joint, name in enumerate(campaign.joint_names)
        ]
        lines.append(("time_s", None, poses.time_s))
        names = [artefact.id for artefact in campaign.artefacts]
        never_excluded = np.zeros(len(poses), dtype=np.bool_)
        clusters: list[ExcludedCluster] = []
        last = self
        # Neighbouring samples of a stream are out together because they are alike.
        while len(clusters) < _MOST_CLUSTERS and not campaign.is_stream:
            place = find_outlier_cluster(
                lines, poses.artefacts, names, last.included, n_draws=_N_DRAWS, seed=1
            )
            if place is None:
                break
            in_cluster = np.zeros(len(poses), dtype=np.bool_)
            if place.joint is not None:
                read_rad = poses.angles_rad[:, campaign.joint_names.index(place.joint)]
                in_cluster = (read_rad >= place.low) & (read_rad <= place.high)
            in_cluster &= ~last.included
            if np.any(in_cluster):
                w = last.statistics.w
                in_cluster &= ~(w > _MUCH_WORSE * np.nanmedian(w[in_cluster]))
            artefacts = np.unique(poses.artefacts[in_cluster])
            of_joint = (
                place.joint is not None
                and (len(artefacts) > 1 or len(np.unique(poses.artefacts)) == 1)
                and place.log_p < math.log(_BY_CHANCE)
            )
            clusters.append(ExcludedCluster(place, of_joint))
            if not of_joint:
                break
            never_excluded |= in_cluster
            last = again(never_excluded)
        return last, tuple(clusters)

    def excluded_part(self, at: int) -> str:
        """Say which part of an excluded pose contradicts the others."""
        position, orientation = (
            self.statistics.w_position,
            self.statistics.w_orientation,
        )
        if np.isnan(position[at]) or orientation[at] < self.critical:
            return "position"
        return "position and orientation"


def adjust_iteratively(
    network: Network,
    design: ArmValues,
    options: Options,
    *,
    first: Booleans | None = None,
    never_excluded: Booleans | None = None,
    progress: Progress | None = None,
    most_iterations: int | None = None,
) -> IteratedAdjustment:
    """Adjust until neither the poses that take part nor the noise change.

    Poses of the network's stations may take part; the first ones do to begin with
    (default all), and some are never excluded (default none), (n_poses,) each.
    """
    campaign = network.campaign
    # From where the family has its arms: there are undetermined directions held, too.
    design = network.parameters.as_expected(design)
    if network.parameters.mounted:
        # Wherever an instrument's probe is mounted is as plausible as anywhere else.
        design = network.start(design).arm
    variances = options.variances or variance_model(campaign)
    most = MOST_ITERATIONS if most_iterations is None else most_iterations
    iterations: list[Iteration] = []
    n_trials_left = MOST_TRIALS

    def adjusted(
        included: Booleans, arm: ArmValues, noise: Noise | None = None
    ) -> tuple[Adjustment, PoseStatistics]:
        nonlocal n_trials_left
        part = network.of_poses(included, noise)
        adjustment = adjust(part, part.start(arm), design, progress, most)
        iterations.extend(adjustment.iterations)
        adjustment, n_trials = with_balls_on_the_right_side(
            adjustment, design, n_trials_left
        )
        n_trials_left -= n_trials
        return adjustment, adjustment.pose_statistics()

    eligible = network.included
    never_excluded = (
        np.zeros_like(eligible) if never_excluded is None else eligible & never_excluded
    )
    included = eligible if first is None else eligible & first | never_excluded
    adjustment, statistics = adjusted(included, design)
    if options.snooping and (
        not adjustment.converged
        or adjustment.sigma0 > _BLUNDERS * statistics.robust_scale
    ):
        state = network.start(design)
        state, included = robust_state(network, state, design)
        included = included & eligible | never_excluded
        adjustment, statistics = adjusted(included, state.arm)
    critical = float("inf")
    visited: list[Booleans] = []
    alternating, n_bad = np.zeros_like(eligible), 0
    for _ in range(_MOST_ROUNDS):
        noise, change = better_noise(
            campaign, adjustment.network.noise, statistics.variances, variances
        )
        n_changed, going_on = 0, included
        if options.snooping:
            following, critical = snoop(
                adjustment,
                statistics,
                included,
                eligible,
                family_level=options.family_level,
                noise_known=not variances.estimates,
            )
            going_on = following | never_excluded
            n_changed = int(np.count_nonzero(going_on != included))
        n_bad += not adjustment.converged
        if (change < _NOISE_SETTLED and n_changed == 0) or n_bad == _MOST_BAD:
            break
        circle = _circle(visited, going_on) if n_changed else []
        if circle:
            # Out for good: what remains cannot alternate by them.
            alternating |= np.any(circle, axis=0) & ~np.all(circle, axis=0)
            eligible = eligible & ~alternating
            visited, going_on = [], going_on & eligible | never_excluded
        visited.append(going_on)
        included = going_on
        adjustment, statistics = adjusted(included, adjustment.state.arm, noise)
    if not np.all(included):
        left_out = network.stations_of(~included)
        statistics.fill(adjustment.pose_statistics(left_out), ~included)
    return IteratedAdjustment(
        adjustment,
        statistics,
        included,
        alternating,
        critical,
        tuple(iterations),
        variances.estimates and _is_estimated(adjustment.network),
        design,
    )


def _is_estimated(network: Network) -> bool:
    """Return whether any standard deviation is not as stated or assumed."""
    noise, a_priori = network.noise, a_priori_noise(network.campaign)
    return not (
        np.array_equal(noise.encoder_rad, a_priori.encoder_rad)
        and np.array_equal(noise.contact_mm, a_priori.contact_mm)
        and noise.orientation_rad == a_priori.orientation_rad
    )


def _circle(visited: list[Booleans], included: Booleans) -> list[Booleans]:
    """Find the recurring selections of poses; none without a cycle."""
    same = [
        index for index, past in enumerate(visited) if np.array_equal(past, included)
    ]
    return [] if len(same) < _A_CIRCLE - 1 else visited[same[-1] :]


# Poses leave together when their |w| is above this part of the worst one's.
_NEAR_THE_WORST = 0.4
# An artefact keeps at least this part of its poses: else the artefact is wrong.
_LEAST_PART = 0.5


def snoop(
    adjustment: Adjustment,
    statistics: PoseStatistics,
    included: Booleans,
    eligible: Booleans,
    *,
    family_level: float,
    noise_known: bool,
) -> tuple[Booleans, float]:
    """Decide who of the eligible poses takes part in the next adjustment, (n_poses,).

    And the |w| above which a pose is excluded.
    A campaign without blunders loses any pose with the probability of the family. Where
    the noise is known the test is that of w, else that of tau.
    """
    n_poses = max(int(np.count_nonzero(included)), 1)
    level = family_level / n_poses
    scale = statistics.robust_scale
    if noise_known:
        scale = max(scale, 1.0)
        critical = returning = -normal_quantile(0.5 * level)
    else:
        # Those outside took no part in the estimate of the noise.
        critical = tau_critical(level, max(adjustment.redundancy, 2))
        returning = student_critical(level, adjustment.redundancy)
    w = np.where(included, np.nan_to_num(statistics.w) / scale, 0.0)
    worst = float(np.max(w, initial=0.0))
    leaving = w > max(critical, _NEAR_THE_WORST * worst)
    leaving &= _not_too_many(adjustment, w, leaving)
    outside = eligible & ~included
    back = np.zeros_like(included)
    if np.any(outside):
        left_out = adjustment.network.stations_of(outside)
        theirs = adjustment.pose_statistics(left_out).w / scale
        back = outside & (np.nan_to_num(theirs, nan=np.inf) < returning)
    return (included & ~leaving) | back, critical * scale


def _not_too_many(adjustment: Adjustment, w: Floats, leaving: Booleans) -> Booleans:
    """Keep the better half of every artefact's poses."""
    may_leave = np.ones_like(leaving)
    poses_of = adjustment.network.campaign.poses.artefacts
    for station in adjustment.network.stations:
        total = np.count_nonzero(poses_of == station.index)
        spare = len(station.poses) - int(np.ceil(_LEAST_PART * total))
        mine = station.poses[leaving[station.poses]]
        if len(mine) > spare:
            order = mine[np.argsort(w[mine])]
            may_leave[order[: len(mine) - max(spare, 0)]] = False
    return may_leave
