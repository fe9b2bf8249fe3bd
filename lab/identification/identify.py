"""Identification: from a campaign and an arm's design to the arm as it is."""

from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.prior import Prior
from traverse.lab.identification.equations.datum import with_datum
from traverse.lab.identification.equations.effect_model import effect_model
from traverse.lab.identification.equations.first_moments import with_first_moments
from traverse.lab.identification.equations.network import (
    Network,
    Noise,
    State,
    network_of,
    rms_mm,
    start_state,
)
from traverse.lab.identification.equations.parameters import (
    ArmValues,
    Parameters,
    arm_parameters,
    expected_by,
    masked,
)
from traverse.lab.identification.optimal_design import (
    joint_coverage,
    most_helpful_poses,
)
from traverse.lab.identification.results.orientations import orientation_result
from traverse.lab.identification.results.postprocessing import (
    arm_of_adjustment,
    artefact_results,
    cartesian_covariance,
    condition_number,
    global_test,
    parameter_estimates,
    variance_factor,
)
from traverse.lab.identification.results.result import ExcludedPose, Identification
from traverse.lab.identification.results.undetermined import (
    undetermined_directions,
    weak_directions,
)
from traverse.lab.identification.solve.adjustment import (
    MOST_ITERATIONS,
    Progress,
    adjust,
)
from traverse.lab.identification.solve.contradictions import (
    Contradiction,
    ExcludedCluster,
    contradicted_expectation,
    lost_poses,
    with_clusters_back,
    without_wrong_certificates,
)
from traverse.lab.identification.solve.iterative_adjustment import (
    IteratedAdjustment,
    Options,
    iterate,
)
from traverse.lab.identification.solve.noise import VarianceModel, serial_noise
from traverse.lab.identification.solve.starting_values import (
    coarse_start,
    with_tools_fitted,
)
from traverse.lab.identification.solve.wrong_orientations import (
    WrongOrientation,
    are_inverse,
    excluded_part,
    without_wrong_orientations,
)
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


class IdentificationError(ValueError):
    """The arm, the campaign and the wishes do not fit together."""


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
    options, given, source = options or Options(), campaign, arm
    _check_same_joints(campaign, arm)
    arm, design, parameters = _begun_with(campaign, arm, options)
    radius_mm = arm.probe.radius_mm
    every = np.ones(len(campaign.poses), dtype=np.bool_)
    network = network_of(campaign, radius_mm, every, parameters)
    before = _begun(network, design)
    rms_before_mm = rms_mm(network, before)
    given_mm, unturned = design.tools_mm, design.mountings
    start = design = with_tools_fitted(campaign, parameters, design, radius_mm)
    if options.coarse_start:
        start = coarse_start(campaign, parameters, design, radius_mm, options.hold)

    def adjusted(
        measured: Campaign,
        noise: Noise | None = None,
        staying: Booleans | None = None,
    ) -> IteratedAdjustment:
        part = network_of(measured, radius_mm, every, parameters, noise)
        held = VarianceModel("held", "held")
        wishes = options if noise is None else replace(options, variances=held)
        return iterate(
            part,
            start,
            wishes,
            radius_mm,
            staying=staying,
            progress=progress,
            most_iterations=MOST_ITERATIONS if noise is None else _MOST_OF_A_TRIAL,
        )

    run = adjusted(campaign)
    if start is not design:
        as_given = iterate(network, design, options, radius_mm, progress=progress)
        if not _fits_better((run, start), (as_given, design)):
            run, start = as_given, design
    zero_offsets_rad = start.geometry.zeros_rad - design.geometry.zeros_rad
    design = replace(start, tools_mm=given_mm, mountings=unturned)
    contradictions: tuple[Contradiction, ...] = ()
    wrong: tuple[WrongOrientation, ...] = ()
    clusters: tuple[ExcludedCluster, ...] = ()
    if options.snooping:
        campaign, run, wrong = without_wrong_orientations(campaign, run, adjusted)
        campaign, run, contradictions = without_wrong_certificates(
            campaign, run, adjusted, design
        )
        run, clusters = with_clusters_back(campaign, run, adjusted)
    contradicted = contradicted_expectation(run.adjustment)
    if contradicted is not None and given.prior is not None:
        believed = replace(given, prior=given.prior.without(*contradicted))
        return identify(believed, source, options, progress)
    alone, included = run.adjustment, run.included
    adjustment, serial, iterations = alone, None, run.iterations
    sigma0, redundancy, shared = alone.sigma0, alone.redundancy, 1.0
    if campaign.is_stream:
        serial = serial_noise(alone)
        # Samples weigh what they say together; certificates keep their weight: a
        # standard is as uncertain as it was.
        network = replace(
            alone.network, weights=alone.network.weights / serial.samples_per_mean
        )
        adjustment = adjust(network, alone.state, design, progress)
        iterations = (*iterations, *adjustment.iterations)
        redundancy, shared = serial.redundancy, serial.samples_per_square
        sigma0 = float(np.sqrt(alone.system.sum_of_squares / max(redundancy, 1)))
    test = global_test(sigma0, redundancy / shared, noise_estimated=run.noise_estimated)
    factor = variance_factor(sigma0, test)
    inverse = adjustment.split.inverse
    covariance = factor * inverse @ inverse.T
    estimates = parameter_estimates(adjustment, design, covariance)
    return Identification(
        arm=arm_of_adjustment(arm, adjustment),
        design=source,
        campaign=campaign,
        adjustment=adjustment,
        converged=adjustment.converged,
        iterations=iterations,
        sigma0=sigma0,
        redundancy=redundancy,
        global_test=test,
        variance_factor=factor,
        noise=adjustment.network.noise,
        serial_noise=serial,
        rms_before_mm=rms_before_mm,
        rms_after_mm=rms_mm(adjustment.network, adjustment.state),
        parameters=estimates,
        covariance=covariance,
        cartesian=cartesian_covariance(adjustment, covariance),
        undetermined=undetermined_directions(adjustment),
        weak=weak_directions(adjustment, factor),
        artefacts=artefact_results(adjustment, run.statistics, factor),
        statistics=run.statistics,
        included=included,
        excluded=tuple(
            ExcludedPose(
                int(campaign.poses.lines[at]),
                float(run.statistics.w[at]),
                excluded_part(run, int(at)),
            )
            for at in np.flatnonzero(~included)
        ),
        alternating=tuple(campaign.poses.lines[run.alternating].tolist()),
        critical_w=run.critical,
        coverage=joint_coverage(campaign, np.flatnonzero(included)),
        condition_number=condition_number(adjustment),
        contradictions=contradictions,
        lost_poses=lost_poses(campaign, run),
        clusters=clusters,
        suggestions=most_helpful_poses(adjustment, options.n_suggestions),
        zero_offsets_rad=zero_offsets_rad,
        options=options,
        orientations=orientation_result(
            adjustment,
            given,
            radius_mm,
            used=included & campaign.poses.oriented,
            before=before,
            sums=run.statistics.variances,
            stds={entry.name: entry.std for entry in estimates},
            excluded=wrong,
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


def prepared(
    campaign: Campaign, arm: Arm, options: Options
) -> tuple[ArmValues, Parameters]:
    """Make the design's values, and choose what is free.

    Raises:
        IdentificationError: A pattern fits no parameter, or effects do not fit.
    """
    geometry, prior = geometry_from_arm(arm), campaign.prior
    # Directions of components, and which are held, decide what others mean to a family.
    of_design = geometry if prior is None else geometry_from_arm(prior.design)
    try:
        effects = effect_model(arm, arm.effects, campaign) if arm.effects else None
    except ValueError as error:
        raise IdentificationError(str(error)) from error
    names = [tool.name for tool in campaign.tools]
    mounted = campaign.poses.mounted
    parameters = arm_parameters(
        of_design, campaign.joint_names, effects, names, mounted
    )
    in_the_arms_system = any(artefact.fixes_datum for artefact in campaign.artefacts)
    wishes = (*(("origin.*",) if in_the_arms_system else ()), *options.free)
    tools_mm = np.array(
        [tool.vector_mm or geometry.probe_vector_mm for tool in campaign.tools]
    ).reshape(-1, 3)
    try:
        held = [f"tool.{name}.?" for name in _held_tools(campaign)]
        parameters = parameters.with_free(masked(parameters, held, ()))
        parameters = parameters.with_free(masked(parameters, options.hold, wishes))
        if effects is not None:
            # Where no mass is known, what yields is estimated with what it yields to.
            wishes = (*wishes, *effects.moments_with(parameters.free_names))
            parameters = parameters.with_free(masked(parameters, options.hold, wishes))
    except ValueError as error:
        raise IdentificationError(str(error)) from error
    if not in_the_arms_system:
        parameters = with_datum(parameters, of_design, tools_mm=tools_mm)
    values = np.empty(0) if effects is None else effects.effects.values
    if prior is not None:
        _check_same_datum(prior, parameters)
        expected = expected_by(prior, of_design, campaign)
        parameters = replace(parameters, expected=expected)
    unturned = np.tile([1.0, 0.0, 0.0, 0.0], (len(mounted), 1))
    return ArmValues(geometry, values, tools_mm, unturned), parameters


_OF_DATUM = (".axis.", ".link.", "origin.")


def _check_same_datum(prior: Prior, parameters: Parameters) -> None:
    """Refuse a family whose parameters mean something else, as others were held.

    Raises:
        IdentificationError: Other axes, links or origins are free than in the family.
    """
    theirs, ours = (
        {name for name in names if any(part in name for part in _OF_DATUM)}
        for names in (prior.estimated, parameters.free_names)
    )
    if theirs != ours:
        raise IdentificationError(
            f"{prior.family}: its arms were identified with other parameters free: "
            f"{', '.join(sorted(theirs ^ ours))}; identify all with the "
            "same --hold and --free, on artefacts of the same kind of place"
        )


def _held_tools(campaign: Campaign) -> list[str]:
    """Name the tools that are held.

    Where no pose has the arm's own, the first one is: what its vector is off is in
    the last link, as that of the probe is otherwise.
    """
    if campaign.poses.tools is None:
        return []
    used = np.unique(campaign.poses.tools)
    return [
        tool.name
        for number, tool in enumerate(campaign.tools, start=1)
        if tool.held or number not in used or number == used[0]
    ]
