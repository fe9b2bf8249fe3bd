"""What the steps of an identification hand on, and the result collected of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment import (
    Adjustment,
    ArmValues,
    IteratedAdjustment,
    Noise,
    Options,
    PoseStatistics,
    Problem,
    adjust_iteratively,
)
from traverse.lab.artefacts.artefact import Artefact, Length
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.certificates import (
    ContactShift,
    lost_poses,
)
from traverse.lab.identification.optimal_design import (
    joint_coverage,
    most_helpful_poses,
)
from traverse.lab.identification.results.orientations import (
    WrongOrientation,
    orientation_result,
)
from traverse.lab.identification.results.result import (
    ArtefactResult,
    EstimatedLength,
    Identification,
)
from traverse.lab.identification.results.undetermined import (
    undetermined_directions,
    weak_directions,
)
from traverse.lab.identification.stream_noise import SerialNoise
from traverse.lab.outcomes.adjustment import Iteration, Progress
from traverse.lab.outcomes.identified import (
    ContradictedCertificate,
    ExcludedPose,
    ParameterEstimate,
)
from traverse.lab.statistics.distributions import (
    arm_variance_factor,
    global_test,
    variance_factor,
)
from traverse.lab.statistics.outlier_clusters import ExcludedCluster

# Of a hypothesis: a wrong one creeps, a right one is there by then.
_MOST_OF_A_TRIAL = 25


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """What an adjustment begins with.

    Attributes:
        source: The arm as given; `arm` has what masses are assumed beside that.
        problem: With the values of that arm.
        rms_before_mm: Of the misclosures with the arm as given.
        orientation_rms_before_rad: Likewise of orientations, 0 without any.
        design: As given, with free tools fitted and wrong signs reversed.
        begin: Where the adjustment begins: the design, or one with other zeros.
        reversed_joints: Numbers of the joints whose signs were wrong.
    """

    source: Arm
    arm: Arm
    problem: Problem
    options: Options
    progress: Progress | None
    rms_before_mm: float
    orientation_rms_before_rad: float
    design: ArmValues
    begin: ArmValues
    reversed_joints: tuple[int, ...]

    @property
    def campaign(self) -> Campaign:
        """As measured."""
        return self.problem.campaign

    def adjusted(
        self,
        campaign: Campaign,
        noise: Noise | None = None,
        never_excluded: Booleans | None = None,
        begin: ArmValues | None = None,
    ) -> IteratedAdjustment:
        """Adjust a campaign, with a given noise only as long as a trial deserves."""
        options, most = self.options, None
        if noise is not None:
            options, most = options.with_noise_held, _MOST_OF_A_TRIAL
        return adjust_iteratively(
            replace(self.problem, campaign=campaign).network(noise=noise),
            self.begin if begin is None else begin,
            options,
            never_excluded=never_excluded,
            progress=self.progress,
            most_iterations=most,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """An adjustment of a campaign, and what contradicted the rest of it.

    Attributes:
        begin: Where the adjustment began.
        design: From which changes are counted.
    """

    campaign: Campaign
    run: IteratedAdjustment
    begin: ArmValues
    design: ArmValues
    contradictions: tuple[ContradictedCertificate, ...] = ()
    contact_shift: ContactShift | None = None
    wrong_orientations: tuple[WrongOrientation, ...] = ()
    clusters: tuple[ExcludedCluster, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Weighted:
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


def collected(start: Start, solution: Solution, weighted: Weighted) -> Identification:
    """Put the result of an adjustment into figures."""
    campaign, run = solution.campaign, solution.run
    adjustment, included = weighted.adjustment, solution.run.included
    test = global_test(
        weighted.sigma0,
        weighted.redundancy / weighted.samples_per_square,
        noise_estimated=run.noise_estimated,
    )
    factor = variance_factor(weighted.sigma0, test)
    shift = solution.contact_shift
    of_design = adjustment.deviations_of_design(
        solution.design, shift.other_scale if shift else 0.0
    )
    samples_per_mean = weighted.serial.samples_per_mean if weighted.serial else 1.0
    of_arm = arm_variance_factor(
        factor,
        test,
        weighted.redundancy / samples_per_mean,
        adjustment.split.n_determined,
    )
    covariance = adjustment.covariance(of_arm, of_design)
    estimates = parameter_estimates(adjustment, solution.design, covariance)
    artefacts = artefact_results(adjustment, run.statistics, factor, of_design)
    names = campaign.joint_names
    zeros_rad = solution.begin.geometry.zeros_rad
    return Identification(
        arm=adjustment.arm_as_estimated(start.arm),
        design=start.source,
        campaign=campaign,
        adjustment=adjustment,
        converged=adjustment.converged,
        iterations=weighted.iterations,
        sigma0=weighted.sigma0,
        redundancy=weighted.redundancy,
        global_test=test,
        variance_factor=of_arm,
        noise=adjustment.network.noise,
        serial_noise=weighted.serial,
        rms_before_mm=start.rms_before_mm,
        rms_after_mm=adjustment.network.rms_mm(adjustment.state),
        parameters=estimates,
        covariance=covariance,
        cartesian=adjustment.cartesian_covariance(covariance),
        undetermined=undetermined_directions(adjustment),
        weak=weak_directions(adjustment, factor),
        artefacts=artefacts,
        statistics=run.statistics,
        included=included,
        excluded=tuple(
            ExcludedPose(
                int(campaign.poses.lines[index]),
                float(run.statistics.w[index]),
                run.excluded_part(int(index)),
            )
            for index in np.flatnonzero(~included)
        ),
        alternating=tuple(campaign.poses.lines[run.alternating].tolist()),
        critical_w=run.critical,
        coverage=joint_coverage(campaign, np.flatnonzero(included)),
        condition_number=condition_number(adjustment),
        contradictions=tuple(
            _measured(entry, artefacts) for entry in solution.contradictions
        ),
        contact_shift=solution.contact_shift,
        wrong_signs=tuple(names[joint] for joint in start.reversed_joints),
        lost_poses=lost_poses(campaign, run),
        clusters=solution.clusters,
        suggestions=most_helpful_poses(adjustment, start.options.n_suggestions),
        zero_offsets_rad=zeros_rad - start.design.geometry.zeros_rad,
        options=start.options,
        orientations=orientation_result(
            adjustment,
            start.campaign,
            used=included & campaign.poses.oriented,
            rms_before_rad=start.orientation_rms_before_rad,
            squares_of_parts=run.statistics.variances.of_parts,
            stds={entry.name: entry.std for entry in estimates},
            excluded=solution.wrong_orientations,
        ),
    )


def _measured(
    entry: ContradictedCertificate, artefacts: Sequence[ArtefactResult]
) -> ContradictedCertificate:
    """Put in what the measurements say of the length; of two radii the first."""
    lengths = next(a.lengths for a in artefacts if a.id == entry.artefact)
    length = next(length for length in lengths if length.name == entry.length)
    return replace(entry, value_mm=length.value_mm, std_mm=length.std_mm)


# Redundancy of a certificate below which nothing else says what it says.
_INDEPENDENT = 1e-9


def parameter_estimates(
    adjustment: Adjustment, design: ArmValues, covariance: Floats
) -> tuple[ParameterEstimate, ...]:
    """List the free parameters, as changes in the design's basis."""
    parameters = adjustment.network.parameters
    changes = parameters.coordinates(adjustment.state.arm, design)[parameters.free]
    variances = np.diag(covariance)
    normal = np.sum(adjustment.system.upper[:, :-1] ** 2, axis=0)
    products = normal * np.sum(adjustment.split.inverse**2, axis=1)
    safe = np.where(products > 0.0, products, np.inf)
    controllability = np.clip(1.0 / safe, 0.0, 1.0)
    return tuple(
        ParameterEstimate(name, float(value), unit_name, float(std), float(control))
        for name, value, unit_name, std, control in zip(
            parameters.free_names,
            changes,
            parameters.free_units,
            np.sqrt(np.maximum(variances, 0.0)),
            controllability,
            strict=True,
        )
    )


def artefact_results(
    adjustment: Adjustment, statistics: PoseStatistics, factor: float, of_design: Floats
) -> tuple[ArtefactResult, ...]:
    network, results = adjustment.network, []
    for index, station in enumerate(network.stations):
        artefact, unknowns = station.artefact, adjustment.state.unknowns[index]
        everyone = np.flatnonzero(network.campaign.poses.artefacts == station.index)
        rms_mm, mean_distance_mm = _sizes(statistics, station.poses, artefact)
        rms_all_mm, mean_distance_all_mm = _sizes(statistics, everyone, artefact)
        results.append(
            ArtefactResult(
                id=artefact.id,
                kind=artefact.kind,
                n_poses=len(station.poses),
                rms_mm=rms_mm,
                mean_distance_mm=mean_distance_mm,
                n_all=len(everyone),
                rms_all_mm=rms_all_mm,
                mean_distance_all_mm=mean_distance_all_mm,
                lengths=tuple(
                    _estimated_length(adjustment, index, length, factor, of_design)
                    for length in artefact.lengths(unknowns)
                ),
                contact_mm=float(network.noise.contact_mm[station.index]),
                place=artefact.place(unknowns),
            )
        )
    return tuple(results)


def condition_number(adjustment: Adjustment) -> float:
    columns = adjustment.system.upper[:, :-1]
    if columns.shape[1] == 0 or adjustment.split.n_determined == 0:
        return 1.0
    sizes = np.linalg.norm(columns, axis=0)
    values = np.linalg.svd(columns / np.where(sizes > 0.0, sizes, 1.0))[1]
    return float(values[0] / values[adjustment.split.n_determined - 1])


def _sizes(
    statistics: PoseStatistics, poses: Integers, artefact: Artefact
) -> tuple[float, float | None]:
    """Return the rms of some misclosures, and of known points the mean length."""
    own_mm = statistics.misclosures_mm[poses, : artefact.rows_per_pose]
    rms_mm = float(np.sqrt(np.mean(own_mm**2)))
    if artefact.kind != "points":
        return rms_mm, None
    return rms_mm, float(np.linalg.norm(own_mm, axis=1).mean())


def _estimated_length(
    adjustment: Adjustment, at: int, length: Length, factor: float, of_design: Floats
) -> EstimatedLength:
    """Estimate a length from everything but its own certificate, where possible.

    With the misclosure v of the certificate, its standard deviation s and the
    variance h s^2 of the adjusted length, the length without it is the certified one
    plus v / (1 - h), of the variance s^2 h / (1 - h).
    """
    elimination = adjustment.system.eliminations[at]
    by_unknowns = length.by_unknowns @ elimination.gain
    arm = by_unknowns @ elimination.left @ adjustment.split.inverse
    variance_mm2 = float(by_unknowns @ by_unknowns + arm @ arm)
    held = by_unknowns @ elimination.left @ of_design
    value_mm, row = length.value_mm, length.certificate_row
    if row is not None:
        station = adjustment.network.stations[at]
        unknowns = adjustment.state.unknowns[at]
        certificate = station.artefact.certificate(unknowns, station.touches)
        redundancy = 1.0 - variance_mm2 / float(certificate.std_mm[row]) ** 2
        if redundancy > _INDEPENDENT:
            v_mm = float(certificate.misclosures_mm[row])
            value_mm = value_mm - v_mm + v_mm / redundancy
            variance_mm2 = variance_mm2 / redundancy
    std_mm = float(np.sqrt(factor * variance_mm2 + held @ held))
    return EstimatedLength(length.name, value_mm, std_mm)
