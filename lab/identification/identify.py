"""Identification: from a campaign and an arm's design to the arm as it is."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment.clusters import ExcludedCluster, with_clusters_back
from traverse.lab.adjustment.equations import rms_mm
from traverse.lab.adjustment.estimates import (
    arm_of_adjustment,
    cartesian_covariance,
    deviations_of_design,
    global_test,
    variance_factor,
)
from traverse.lab.adjustment.iterate import IteratedAdjustment, iterate
from traverse.lab.adjustment.noise import Noise, VarianceModel
from traverse.lab.adjustment.parameters import (
    ArmValues,
    Parameters,
)
from traverse.lab.adjustment.prepare import IdentificationError, Options, prepared
from traverse.lab.adjustment.problem import Network, State, network_of
from traverse.lab.adjustment.snooping import contradicted_expectation
from traverse.lab.adjustment.solve import MOST_ITERATIONS, Adjustment, adjust
from traverse.lab.adjustment.starting_values import (
    CoarseStart,
    coarse_start,
    start_state,
    with_tools_fitted,
)
from traverse.lab.adjustment.wrong_orientations import excluded_part
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.first_moments import with_first_moments
from traverse.lab.identification.certificates import (
    ContactShift,
    Contradiction,
    lost_poses,
    without_wrong_certificates,
)
from traverse.lab.identification.optimal_design import (
    joint_coverage,
    most_helpful_poses,
)
from traverse.lab.identification.results.orientations import orientation_result
from traverse.lab.identification.results.postprocessing import (
    artefact_results,
    condition_number,
    parameter_estimates,
)
from traverse.lab.identification.results.result import ExcludedPose, Identification
from traverse.lab.identification.results.undetermined import (
    undetermined_directions,
    weak_directions,
)
from traverse.lab.identification.stream_noise import SerialNoise, serial_noise
from traverse.lab.identification.wrong_orientations import (
    WrongOrientation,
    are_inverse,
    without_wrong_orientations,
)
from traverse.lab.outcomes.progress import Iteration, Progress
from traverse.strict_toml.reader import StrictModel

__all__ = ["IdentificationError", "Options", "identify"]


# Of a hypothesis: a wrong one creeps, a right one is there by then.
_MOST_OF_A_TRIAL = 25


# Other zeros must make the median misclosure smaller than this part of it.
_WORTH_IT = 0.95


class Masks(StrictModel):
    """A file that says which parameters are held and which are free, by patterns.

    schema = "traverse/identification-masks/1"
    hold = ["J7.*"]
    free = ["probe.vector.*"]

    `hold` has the last word.
    """

    schema_: Literal["traverse/identification-masks/1"] = Field(alias="schema")
    hold: tuple[str, ...] = ()
    free: tuple[str, ...] = ()


def identify(
    campaign: Campaign,
    arm: Arm,
    options: Options | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify an arm, given its design or an earlier identification.

    Every iteration is reported to `progress`.

    Raises:
        IdentificationError: Arm and campaign do not fit together, or a pattern fits
            no parameter.
    """
    options = options or Options()
    _check_same_joints(campaign, arm)
    start = _start(campaign, arm, options, progress)
    fit = _fit(start, start.adjust_campaign(campaign))
    if options.snooping:
        fit = _without_contradictions(start, fit)
    contradicted = contradicted_expectation(fit.run.adjustment)
    if contradicted is not None and campaign.prior is not None:
        without_prior = replace(campaign, prior=campaign.prior.without(*contradicted))
        return identify(without_prior, arm, options, progress)
    return _collected(start, fit, _weighted(start, fit))


@dataclass(frozen=True, slots=True, eq=False)
class _Start:
    """What an adjustment begins with.

    Attributes:
        source: The arm as given; `arm` has what masses are assumed beside that.
        given: Values of that arm, and `before` the artefacts as seen with it.
        design: As given, with free tools fitted and wrong signs reversed.
        begin: Where the adjustment begins: the design, or one with other zeros.
    """

    campaign: Campaign
    source: Arm
    arm: Arm
    options: Options
    progress: Progress | None
    parameters: Parameters
    given: ArmValues
    before: State
    rms_before_mm: float
    design: ArmValues
    begin: ArmValues
    wrong_signs: tuple[int, ...]

    @property
    def radius_mm(self) -> float:
        """Of the probe's ball."""
        return self.arm.probe.radius_mm

    def adjust_campaign(
        self,
        campaign: Campaign,
        noise: Noise | None = None,
        staying: Booleans | None = None,
        begin: ArmValues | None = None,
    ) -> IteratedAdjustment:
        """Adjust a campaign, with a given noise only as long as a trial deserves."""
        every = np.ones(len(campaign.poses), dtype=np.bool_)
        network = network_of(campaign, self.radius_mm, every, self.parameters, noise)
        options = self.options
        if noise is not None:
            options = replace(options, variances=VarianceModel("held", "held"))
        return iterate(
            network,
            self.begin if begin is None else begin,
            options,
            self.radius_mm,
            staying=staying,
            progress=self.progress,
            most_iterations=MOST_ITERATIONS if noise is None else _MOST_OF_A_TRIAL,
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """An adjustment of a campaign, and what contradicted the rest of it.

    Attributes:
        begin: Where the adjustment began.
        design: From which changes are counted.
    """

    campaign: Campaign
    run: IteratedAdjustment
    begin: ArmValues
    design: ArmValues
    contradictions: tuple[Contradiction, ...] = ()
    contact_shift: ContactShift | None = None
    wrong_orientations: tuple[WrongOrientation, ...] = ()
    clusters: tuple[ExcludedCluster, ...] = ()


def _start(
    campaign: Campaign, source: Arm, options: Options, progress: Progress | None
) -> _Start:
    """Choose what is free, place the artefacts, and try other signs and zeros.

    Raises:
        IdentificationError: A pattern fits no parameter, effects do not fit, or
            orientations are those of the inverse rotations.
    """
    arm, given, parameters = _begun_with(campaign, source, options)
    radius_mm = arm.probe.radius_mm
    every = np.ones(len(campaign.poses), dtype=np.bool_)
    network = network_of(campaign, radius_mm, every, parameters)
    before = _begun(network, given)
    design = with_tools_fitted(campaign, parameters, given, radius_mm)
    coarse = CoarseStart(design, design, ())
    if options.coarse_start:
        coarse = coarse_start(campaign, parameters, design, radius_mm, options.hold)
    return _Start(
        campaign=campaign,
        source=source,
        arm=arm,
        options=options,
        progress=progress,
        parameters=parameters,
        given=given,
        before=before,
        rms_before_mm=rms_mm(network, before),
        design=coarse.design,
        begin=coarse.arm,
        wrong_signs=coarse.reversed_joints,
    )


def _fit(start: _Start, run: IteratedAdjustment) -> _Fit:
    """Decide whether other zeros were worth it; if not, adjust from the design."""
    begin = start.begin
    if begin is not start.design:
        as_given = start.adjust_campaign(start.campaign, begin=start.design)
        if not _fits_better((run, begin), (as_given, start.design)):
            run, begin = as_given, start.design
    given = start.given
    design = replace(begin, tools_mm=given.tools_mm, mountings=given.mountings)
    return _Fit(start.campaign, run, begin, design)


def _without_contradictions(start: _Start, fit: _Fit) -> _Fit:
    """Leave out what contradicts the rest: orientations, certificates, clusters."""

    def adjusted(
        campaign: Campaign,
        noise: Noise | None = None,
        staying: Booleans | None = None,
    ) -> IteratedAdjustment:
        return start.adjust_campaign(campaign, noise, staying, fit.begin)

    campaign, run, wrong = without_wrong_orientations(fit.campaign, fit.run, adjusted)
    campaign, run, contradictions, contact_shift = without_wrong_certificates(
        campaign, run, adjusted, fit.design
    )
    run, clusters = with_clusters_back(campaign, run, adjusted)
    return replace(
        fit,
        campaign=campaign,
        run=run,
        contradictions=contradictions,
        contact_shift=contact_shift,
        wrong_orientations=wrong,
        clusters=clusters,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Weighted:
    """The last adjustment, in which samples of a stream weigh what they say together.

    Attributes:
        samples_per_square: How many squares of residuals say as much as one.
    """

    adjustment: Adjustment
    iterations: tuple[Iteration, ...]
    sigma0: float
    redundancy: int
    serial: SerialNoise | None = None
    samples_per_square: float = 1.0


def _weighted(start: _Start, fit: _Fit) -> _Weighted:
    """Weigh the samples of a stream by what neighbours share, and adjust again."""
    unweighted, iterations = fit.run.adjustment, fit.run.iterations
    if not fit.campaign.is_stream:
        sigma0, redundancy = unweighted.sigma0, unweighted.redundancy
        return _Weighted(unweighted, iterations, sigma0, redundancy)
    serial = serial_noise(unweighted)
    # Certificates keep their weight: a standard is as uncertain as it was.
    network = replace(
        unweighted.network,
        weights=unweighted.network.weights / serial.samples_per_mean,
    )
    adjustment = adjust(network, unweighted.state, fit.design, start.progress)
    squares = unweighted.system.sum_of_squares
    return _Weighted(
        adjustment,
        (*iterations, *adjustment.iterations),
        float(np.sqrt(squares / max(serial.redundancy, 1))),
        serial.redundancy,
        serial,
        serial.samples_per_square,
    )


def _collected(start: _Start, fit: _Fit, weighted: _Weighted) -> Identification:
    """Put the result of an adjustment into figures."""
    campaign, run, adjustment = fit.campaign, fit.run, weighted.adjustment
    test = global_test(
        weighted.sigma0,
        weighted.redundancy / weighted.samples_per_square,
        noise_estimated=run.noise_estimated,
    )
    factor = variance_factor(weighted.sigma0, test)
    inverse = adjustment.split.inverse
    of_design = deviations_of_design(adjustment, fit.design)
    covariance = factor * inverse @ inverse.T + of_design @ of_design.T
    estimates = parameter_estimates(adjustment, fit.design, covariance)
    return Identification(
        arm=arm_of_adjustment(start.arm, adjustment),
        design=start.source,
        campaign=campaign,
        adjustment=adjustment,
        converged=adjustment.converged,
        iterations=weighted.iterations,
        sigma0=weighted.sigma0,
        redundancy=weighted.redundancy,
        global_test=test,
        variance_factor=factor,
        noise=adjustment.network.noise,
        serial_noise=weighted.serial,
        rms_before_mm=start.rms_before_mm,
        rms_after_mm=rms_mm(adjustment.network, adjustment.state),
        parameters=estimates,
        covariance=covariance,
        cartesian=cartesian_covariance(adjustment, covariance),
        undetermined=undetermined_directions(adjustment),
        weak=weak_directions(adjustment, factor),
        artefacts=artefact_results(adjustment, run.statistics, factor, of_design),
        statistics=run.statistics,
        included=run.included,
        excluded=tuple(
            ExcludedPose(
                int(campaign.poses.lines[at]),
                float(run.statistics.w[at]),
                excluded_part(run, int(at)),
            )
            for at in np.flatnonzero(~run.included)
        ),
        alternating=tuple(campaign.poses.lines[run.alternating].tolist()),
        critical_w=run.critical,
        coverage=joint_coverage(campaign, np.flatnonzero(run.included)),
        condition_number=condition_number(adjustment),
        contradictions=fit.contradictions,
        contact_shift=fit.contact_shift,
        wrong_signs=tuple(campaign.joint_names[joint] for joint in start.wrong_signs),
        lost_poses=lost_poses(campaign, run),
        clusters=fit.clusters,
        suggestions=most_helpful_poses(adjustment, start.options.n_suggestions),
        zero_offsets_rad=fit.begin.geometry.zeros_rad - start.design.geometry.zeros_rad,
        options=start.options,
        orientations=orientation_result(
            adjustment,
            start.campaign,
            start.radius_mm,
            used=run.included & campaign.poses.oriented,
            before=start.before,
            sums=run.statistics.variances,
            stds={entry.name: entry.std for entry in estimates},
            excluded=fit.wrong_orientations,
        ),
    )


def _begun_with(
    campaign: Campaign, arm: Arm, options: Options
) -> tuple[Arm, ArmValues, Parameters]:
    """Prepare an adjustment; moments of weight are assumed only to be estimated.

    An effect that is held yields to what the arm file states, or is refused.

    Raises:
        IdentificationError: A pattern fits no parameter, or effects do not fit.
    """
    extended = with_first_moments(arm)
    design, parameters = prepared(campaign, extended, options)
    effects = parameters.effects
    if effects is None or effects.moments_with(parameters.free_names):
        return extended, design, parameters
    return (arm, *prepared(campaign, arm, options))


def _check_same_joints(campaign: Campaign, arm: Arm) -> None:
    """Refuse a campaign of another arm.

    Raises:
        IdentificationError: Its joints have other names.
    """
    names = tuple(joint.name for joint in arm.joints)
    if names != campaign.joint_names:
        raise IdentificationError(
            f"the campaign has the joints {', '.join(campaign.joint_names)}, the arm "
            f"{', '.join(names)}; take the arm file that the campaign was measured with"
        )


def _begun(network: Network, design: ArmValues) -> State:
    """Find artefacts and mountings with the arm as given.

    Raises:
        IdentificationError: Orientations are those of the inverse rotations.
    """
    state = start_state(network, design)
    if network.parameters.mounted and are_inverse(network, state):
        raise IdentificationError(
            "the orientations contradict the positions, and their inverses agree: "
            "orientation_w, _x, _y, _z take vectors from the instrument's probe to the "
            "frame of the points; change the signs of orientation_x, _y and _z"
        )
    return state


def _fits_better(
    found: tuple[IteratedAdjustment, ArmValues],
    as_given: tuple[IteratedAdjustment, ArmValues],
) -> bool:
    """Return whether other zeros are worth it: two adjustments and their starts.

    All poses count, excluded ones too. Axes may turn instead of wrong zeros, so that
    of two good fits the one that changes the arm less is better.
    """
    if found[0].adjustment.converged != as_given[0].adjustment.converged:
        return found[0].adjustment.converged
    medians_mm = [
        np.nanmedian(np.sqrt(np.nansum(run.statistics.misclosures_mm**2, axis=1)))
        for run, _ in (found, as_given)
    ]
    changes = [
        np.sum(run.adjustment.changes(design) ** 2) for run, design in (found, as_given)
    ]
    if medians_mm[0] * _WORTH_IT < medians_mm[1] and changes[0] < changes[1] / 2.0:
        return True
    return bool(medians_mm[0] < _WORTH_IT * medians_mm[1])
