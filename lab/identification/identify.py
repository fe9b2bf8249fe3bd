"""Identification: from a campaign and an arm's design to the arm as it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.arm_file import Arm
from kinematics.geometry import geometry_from_arm
from lab.campaign import Campaign
from lab.identification.adjustment import Adjustment, Iteration, Progress, adjust
from lab.identification.advice import suggestions
from lab.identification.conclusions import (
    artefact_results,
    cartesian_covariance,
    condition_number,
    global_test,
    identified_arm,
    parameter_estimates,
    rms_mm,
    variance_factor,
)
from lab.identification.coverage import joint_coverage
from lab.identification.datum import with_datum
from lab.identification.network import Network, State, start_state, stations
from lab.identification.noise import Noise, a_priori_noise
from lab.identification.parameters import (
    ArmValues,
    Booleans,
    Parameters,
    arm_parameters,
    masked,
)
from lab.identification.pose_statistics import (
    PoseStatistics,
    outsiders_statistics,
    pose_statistics,
)
from lab.identification.result import ExcludedPose, Identification
from lab.identification.robust import robust_state
from lab.identification.snooping import Snooping, robust_scale, snoop
from lab.identification.start import coarse_start
from lab.identification.terms import ProbeTerm
from lab.identification.undetermined import undetermined_directions, weak_directions
from lab.identification.variance_components import (
    VarianceModel,
    better_noise,
    variance_model,
)

Floats = NDArray[np.float64]

_MOST_ROUNDS = 15
# Standard deviations that change by less than this are settled.
_NOISE_SETTLED = 0.01
# A classical sigma0 this much above the robust one betrays blunders.
_BLUNDERS = 1.2


class IdentificationError(ValueError):
    """The arm, the campaign and the wishes do not fit together."""


@dataclass(frozen=True, slots=True)
class Options:
    """Wishes.

    Attributes:
        hold: Patterns of parameters to hold at their design values.
        free: Patterns of parameters to free; `hold` has the last word.
        terms: Beyond the geometry.
        snooping: Whether contradicting poses are excluded.
        family_level: Probability that a campaign without blunders loses any pose.
        variances: Which noise is estimated; None: what the campaign does not give.
        coarse_start: Whether wrong zeros are looked for where the design fits badly.
        n_suggestions: Poses to suggest.
    """

    hold: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    terms: tuple[ProbeTerm, ...] = ()
    snooping: bool = True
    family_level: float = 0.01
    variances: VarianceModel | None = None
    coarse_start: bool = True
    n_suggestions: int = 8


def identify(
    campaign: Campaign,
    arm: Arm,
    options: Options | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify an arm.

    Args:
        campaign: What was measured.
        arm: The design, or an earlier identification.
        options: Wishes.
        progress: Told of every iteration.

    Raises:
        IdentificationError: Arm and campaign do not fit together, or a pattern fits
            no parameter.
    """
    options = options or Options()
    _check(campaign, arm)
    design, parameters = _prepared(campaign, arm, options)
    radius_mm = arm.probe.radius_mm
    included = np.ones(len(campaign.poses), dtype=np.bool_)
    network = Network(
        campaign,
        stations(campaign, radius_mm, included),
        parameters,
        a_priori_noise(campaign),
        np.ones(len(campaign.poses)),
    )
    rms_before_mm = rms_mm(network, start_state(network, design))
    zero_offsets_rad = np.zeros(len(campaign.joint_names))
    if options.coarse_start:
        coarse = coarse_start(campaign, parameters, design, radius_mm)
        design, zero_offsets_rad = coarse.arm, coarse.zero_offsets_rad
    run = _Run(design, options, radius_mm, progress)
    adjustment, found, included, critical = run.to_the_end(network)
    test = global_test(adjustment, noise_estimated=run.variances(campaign).estimates)
    factor = variance_factor(adjustment, test)
    inverse = adjustment.split.inverse
    covariance = factor * inverse @ inverse.T
    poses = np.flatnonzero(included)
    return Identification(
        arm=identified_arm(arm, adjustment),
        design=arm,
        campaign=campaign,
        adjustment=adjustment,
        converged=adjustment.converged,
        iterations=tuple(run.iterations),
        sigma0=adjustment.sigma0,
        redundancy=adjustment.redundancy,
        global_test=test,
        variance_factor=factor,
        noise=adjustment.network.noise,
        rms_before_mm=rms_before_mm,
        rms_after_mm=rms_mm(adjustment.network, adjustment.state),
        parameters=parameter_estimates(adjustment, design, covariance),
        covariance=covariance,
        cartesian=cartesian_covariance(adjustment, covariance),
        undetermined=undetermined_directions(adjustment),
        weak=weak_directions(adjustment, factor),
        artefacts=artefact_results(adjustment, found, factor),
        statistics=found,
        included=included,
        excluded=tuple(
            ExcludedPose(int(campaign.poses.lines[at]), float(found.w[at]))
            for at in np.flatnonzero(~included)
        ),
        critical_w=critical,
        coverage=joint_coverage(campaign, poses),
        condition_number=condition_number(adjustment),
        suggestions=suggestions(adjustment, options.n_suggestions),
        zero_offsets_rad=zero_offsets_rad,
    )


class _Run:
    """Adjust, test, improve the noise, and again, until nothing changes."""

    def __init__(
        self,
        design: ArmValues,
        options: Options,
        radius_mm: float,
        progress: Progress | None,
    ) -> None:
        self._design = design
        self._options = options
        self._radius_mm = radius_mm
        self._progress = progress
        self.iterations: list[Iteration] = []

    def variances(self, campaign: Campaign) -> VarianceModel:
        return self._options.variances or variance_model(campaign)

    def to_the_end(
        self, network: Network
    ) -> tuple[Adjustment, PoseStatistics, Booleans, float]:
        """Return adjustment, statistics of all poses, who took part, critical |w|."""
        campaign = network.campaign
        variances = self.variances(campaign)
        included = np.ones(len(campaign.poses), dtype=np.bool_)
        state = start_state(network, self._design)
        adjustment = self._adjusted(network, state)
        found = pose_statistics(adjustment)
        if self._options.snooping and (
            not adjustment.converged
            or adjustment.sigma0 > _BLUNDERS * robust_scale(found)
        ):
            state, included = robust_state(network, state, self._design)
            adjustment, found = self._without(adjustment, included, state.arm)
        critical = float("inf")
        for _ in range(_MOST_ROUNDS):
            noise, change = better_noise(
                campaign, adjustment.network.noise, found.variances, variances
            )
            tests = self._tests(adjustment, found, included, variances)
            if tests is not None:
                critical = tests.critical * tests.scale
            n_changed = tests.n_changed if tests is not None else 0
            if change < _NOISE_SETTLED and n_changed == 0:
                break
            included = included if tests is None else tests.included
            adjustment, found = self._without(
                adjustment, included, adjustment.state.arm, noise
            )
        return adjustment, self._of_all(adjustment, found, included), included, critical

    def _adjusted(self, network: Network, state: State) -> Adjustment:
        return adjust(network, state, self._design, self._told)

    def _told(self, iteration: Iteration) -> None:
        self.iterations.append(iteration)
        if self._progress is not None:
            self._progress(iteration)

    def _without(
        self,
        adjustment: Adjustment,
        included: Booleans,
        arm: ArmValues,
        noise: Noise | None = None,
    ) -> tuple[Adjustment, PoseStatistics]:
        before = adjustment.network
        network = Network(
            before.campaign,
            stations(before.campaign, self._radius_mm, included),
            before.parameters,
            noise or before.noise,
            before.weights,
        )
        found = self._adjusted(network, start_state(network, arm))
        return found, pose_statistics(found)

    def _tests(
        self,
        adjustment: Adjustment,
        found: PoseStatistics,
        included: Booleans,
        variances: VarianceModel,
    ) -> Snooping | None:
        if not self._options.snooping:
            return None
        return snoop(
            adjustment,
            found,
            included,
            family_level=self._options.family_level,
            noise_known=not variances.estimates,
            radius_mm=self._radius_mm,
        )

    def _of_all(
        self, adjustment: Adjustment, found: PoseStatistics, included: Booleans
    ) -> PoseStatistics:
        """Fill in the statistics of the excluded poses."""
        if np.all(included):
            return found
        campaign = adjustment.network.campaign
        others = stations(campaign, self._radius_mm, ~included)
        theirs = outsiders_statistics(adjustment, others)
        outside = ~included
        for name in (
            "misclosures_mm",
            "statistics",
            "w",
            "degrees",
            "controllability",
            "detectable_mm",
            "influence",
            "corrections_rad",
        ):
            getattr(found, name)[outside] = getattr(theirs, name)[outside]
        return found


def _prepared(
    campaign: Campaign, arm: Arm, options: Options
) -> tuple[ArmValues, Parameters]:
    """Make the design's values, and choose what is free."""
    geometry = geometry_from_arm(arm)
    parameters = arm_parameters(geometry, campaign.joint_names, options.terms)
    in_the_arms_system = any(artefact.fixes_datum for artefact in campaign.artefacts)
    wishes = (*(("origin.*",) if in_the_arms_system else ()), *options.free)
    try:
        parameters = parameters.with_free(masked(parameters, options.hold, wishes))
    except ValueError as error:
        raise IdentificationError(str(error)) from error
    if not in_the_arms_system:
        parameters = with_datum(parameters, geometry)
    n_amplitudes = sum(len(term.names) for term in options.terms)
    return ArmValues(geometry, np.zeros(n_amplitudes)), parameters


def _check(campaign: Campaign, arm: Arm) -> None:
    names = tuple(joint.name for joint in arm.joints)
    if names != campaign.joint_names:
        raise IdentificationError(
            f"the campaign has the joints {', '.join(campaign.joint_names)}, the arm "
            f"{', '.join(names)}; take the arm file that the campaign was measured with"
        )
    if arm.effects:
        kinds = ", ".join(sorted({effect.kind for effect in arm.effects}))
        raise IdentificationError(
            f"arm '{arm.name}' has effects ({kinds}), which identification does not "
            "apply; take them out of the file and diagnose the campaign again"
        )
