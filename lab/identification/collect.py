"""The result of an identification, collected from its adjustment."""

import numpy as np

from traverse.lab.identification.certificates import lost_poses
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
from traverse.lab.identification.solution import Solution, Start, Weighted
from traverse.lab.statistics.distributions import global_test, variance_factor


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
    inverse = adjustment.split.inverse
    of_design = adjustment.deviations_of_design(solution.design)
    covariance = factor * inverse @ inverse.T + of_design @ of_design.T
    estimates = parameter_estimates(adjustment, solution.design, covariance)
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
        variance_factor=factor,
        noise=adjustment.network.noise,
        serial_noise=weighted.serial,
        rms_before_mm=start.rms_before_mm,
        rms_after_mm=adjustment.network.rms_mm(adjustment.state),
        parameters=estimates,
        covariance=covariance,
        cartesian=adjustment.cartesian_covariance(covariance),
        undetermined=undetermined_directions(adjustment),
        weak=weak_directions(adjustment, factor),
        artefacts=artefact_results(adjustment, run.statistics, factor, of_design),
        statistics=run.statistics,
        included=included,
        excluded=tuple(
            ExcludedPose(
                int(campaign.poses.lines[at]),
                float(run.statistics.w[at]),
                run.excluded_part(int(at)),
            )
            for at in np.flatnonzero(~included)
        ),
        alternating=tuple(campaign.poses.lines[run.alternating].tolist()),
        critical_w=run.critical,
        coverage=joint_coverage(campaign, np.flatnonzero(included)),
        condition_number=condition_number(adjustment),
        contradictions=solution.contradictions,
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
