"""Identification: from a campaign and an arm's design to the arm as it is."""

from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment import (
    ArmValues,
    IdentificationError,
    IteratedAdjustment,
    Noise,
    Options,
    Problem,
    adjust,
    find_starting_values,
)
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.first_moments import with_first_moments
from traverse.lab.identification.certificates import without_wrong_certificates
from traverse.lab.identification.results.orientations import (
    are_inverse,
    rms_rad,
    without_wrong_orientations,
)
from traverse.lab.identification.results.result import Identification
from traverse.lab.identification.solution import Solution, Start, Weighted, collected
from traverse.lab.identification.stream_noise import serial_noise
from traverse.lab.outcomes.adjustment import Progress
from traverse.strict_toml.reader import StrictModel

__all__ = ["IdentificationError", "Options", "identify"]


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

    Examples:
        A link is half a millimetre longer than designed. A tracker saw the ball in 80
        postures, to 10 micrometres.

        >>> from importlib.resources import files
        >>> import numpy as np
        >>> from traverse.kinematics.arm_file.arm import read_arm
        >>> from traverse.kinematics.model.forward import probe_centre
        >>> from traverse.kinematics.model.geometry import geometry_from_arm
        >>> from traverse.lab.campaign.campaign import campaign_of_places
        >>> design = read_arm(files("traverse.cli") / "demo_data" / "arm.toml")
        >>> first, second, *others = design.joints
        >>> second = second.model_copy(update={"link_mm": (60.5, 0.0, 0.0)})
        >>> built = design.model_copy(update={"joints": (first, second, *others)})
        >>> rng = np.random.default_rng(1)
        >>> readings_rad = rng.uniform(-2.0, 2.0, (80, 7))
        >>> places_mm = probe_centre(geometry_from_arm(built), readings_rad)
        >>> places_mm += rng.normal(0.0, 0.01, places_mm.shape)
        >>> campaign = campaign_of_places(
        ...     [joint.name for joint in design.joints],
        ...     readings_rad,
        ...     places_mm,
        ...     encoder_rad=1e-6,
        ...     contact_mm=0.01,
        ... )
        >>> result = identify(campaign, design)
        >>> round(result.arm.joints[1].link_mm[0], 1)
        60.5
        >>> f"{result.rms_before_mm:.2f} mm, then {result.rms_after_mm:.3f} mm"
        '0.25 mm, then 0.010 mm'
    """
    options = options or Options()
    _check_same_joints(campaign, arm)
    start = _start(campaign, arm, options, progress)
    solution = _solve(start)
    if options.snooping:
        solution = _test_hypotheses(start, solution)
    contradicted = solution.run.adjustment.contradicted_expectation()
    if contradicted is not None and campaign.prior is not None:
        without_prior = replace(campaign, prior=campaign.prior.without(*contradicted))
        return identify(without_prior, arm, options, progress)
    return collected(start, solution, _weigh_stream(start, solution))


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


def _start(
    campaign: Campaign, source: Arm, options: Options, progress: Progress | None
) -> Start:
    """Choose what is free, place the artefacts, and try other signs and zeros.

    Raises:
        IdentificationError: A pattern fits no parameter, effects do not fit, or
            orientations are those of the inverse rotations.
    """
    arm, problem = _posed(campaign, source, options)
    network = problem.network()
    before = network.start(problem.design)
    oriented = bool(network.parameters.mounted)
    if oriented and are_inverse(network, before.arm, before.unknowns):
        raise IdentificationError(
            "the orientations contradict the positions, and their inverses agree: "
            "orientation_w, _x, _y, _z take vectors from the instrument's probe to the "
            "frame of the points; change the signs of orientation_x, _y and _z"
        )
    begin = find_starting_values(problem, options)
    return Start(
        source=source,
        arm=arm,
        problem=problem,
        options=options,
        progress=progress,
        rms_before_mm=network.rms_mm(before),
        orientation_rms_before_rad=rms_rad(network.orientation_errors_of(before))
        if oriented
        else 0.0,
        design=begin.design,
        begin=begin.arm,
        reversed_joints=begin.reversed_joints,
    )


def _posed(campaign: Campaign, arm: Arm, options: Options) -> tuple[Arm, Problem]:
    """Pose the problem; moments of weight are assumed only to be estimated.

    An effect that is held yields to what the arm file states, or is refused.

    Raises:
        IdentificationError: A pattern fits no parameter, or effects do not fit.
    """
    extended = with_first_moments(arm)
    problem = Problem.of(campaign, extended, options)
    effects = problem.parameters.effects
    if effects is None or effects.moments_with(problem.parameters.free_names):
        return extended, problem
    return arm, Problem.of(campaign, arm, options)


def _solve(start: Start) -> Solution:
    """Adjust; where that began with other zeros, from the design as well."""
    run, begin = start.adjusted(start.campaign), start.begin
    if begin is not start.design:
        as_given = start.adjusted(start.campaign, begin=start.design)
        if not _fits_better((run, begin), (as_given, start.design)):
            run, begin = as_given, start.design
    stated = start.problem.design
    design = replace(begin, tools_mm=stated.tools_mm, mountings=stated.mountings)
    return Solution(start.campaign, run, begin, design)


# Other zeros must make the median misclosure smaller than this part of it.
_WORTH_IT = 0.95


def _fits_better(
    other_zeros: tuple[IteratedAdjustment, ArmValues],
    as_given: tuple[IteratedAdjustment, ArmValues],
) -> bool:
    """Return whether other zeros are worth it: two adjustments and their starts.

    All poses count, excluded ones too. Axes may turn instead of wrong zeros, so that
    of two good fits the one that changes the arm less is better.
    """
    both = (other_zeros, as_given)
    if other_zeros[0].adjustment.converged != as_given[0].adjustment.converged:
        return other_zeros[0].adjustment.converged
    medians_mm = [
        np.nanmedian(np.sqrt(np.nansum(run.statistics.misclosures_mm**2, axis=1)))
        for run, _ in both
    ]
    changes = [np.sum(run.adjustment.changes(design) ** 2) for run, design in both]
    if medians_mm[0] * _WORTH_IT < medians_mm[1] and changes[0] < changes[1] / 2.0:
        return True
    return bool(medians_mm[0] < _WORTH_IT * medians_mm[1])


def _test_hypotheses(start: Start, solution: Solution) -> Solution:
    """Leave out what contradicts the rest: orientations, certificates, clusters.

    Strategy: what a pose alone contradicts is taken out before what a whole artefact
    does; blunders of poses have left already when a certificate is accused.
    """

    def adjusted(
        campaign: Campaign,
        noise: Noise | None = None,
        never_excluded: Booleans | None = None,
    ) -> IteratedAdjustment:
        return start.adjusted(campaign, noise, never_excluded, solution.begin)

    campaign, run, wrong = without_wrong_orientations(
        solution.campaign, solution.run, adjusted
    )
    campaign, run, contradictions, contact_shift = without_wrong_certificates(
        campaign, run, adjusted, solution.design
    )
    run, clusters = run.with_clusters_back(
        campaign,
        lambda never_excluded: adjusted(campaign, never_excluded=never_excluded),
    )
    return replace(
        solution,
        campaign=campaign,
        run=run,
        contradictions=contradictions,
        contact_shift=contact_shift,
        wrong_orientations=wrong,
        clusters=clusters,
    )


def _weigh_stream(start: Start, solution: Solution) -> Weighted:
    """Weigh the samples of a stream by what neighbours share, and adjust again."""
    unweighted, iterations = solution.run.adjustment, solution.run.iterations
    if not solution.campaign.is_stream:
        sigma0, redundancy = unweighted.sigma0, unweighted.redundancy
        return Weighted(unweighted, iterations, sigma0, redundancy)
    serial = serial_noise(unweighted)
    # Certificates keep their weight: a standard is as uncertain as it was.
    network = replace(
        unweighted.network,
        weights=unweighted.network.weights / serial.samples_per_mean,
    )
    adjustment = adjust(network, unweighted.state, solution.design, start.progress)
    squares = unweighted.system.sum_of_squares
    return Weighted(
        adjustment,
        (*iterations, *adjustment.iterations),
        float(np.sqrt(squares / max(serial.redundancy, 1))),
        serial.redundancy,
        serial,
        serial.samples_per_square,
    )
