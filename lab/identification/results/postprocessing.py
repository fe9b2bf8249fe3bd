"""Result of an adjustment: the arm, its parameters, its artefacts, in figures."""

from collections.abc import Sequence

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.kinematics.arm_file.arm import Arm, Probe
from traverse.kinematics.uncertainty.arm_covariance import parameter_names
from traverse.lab.artefacts.artefact import Artefact, Length
from traverse.lab.identification.equations.parameters import ArmValues
from traverse.lab.identification.results.result import (
    ArtefactResult,
    CartesianCovariance,
    EstimatedLength,
    ParameterEstimate,
)
from traverse.lab.identification.solve.adjustment import Adjustment, design_spread
from traverse.lab.identification.solve.reliability import PoseStatistics
from traverse.lab.statistics.distributions import GlobalTest, chi_square_p_value

# Redundancy of a certificate below which nothing else says what it says.
_INDEPENDENT = 1e-9


def arm_of_adjustment(arm: Arm, adjustment: Adjustment) -> Arm:
    """Put the estimated geometry into an arm; provenance is added on writing."""
    geometry = adjustment.state.arm.geometry
    joints = tuple(
        joint.model_copy(
            update={
                "axis": _vector(geometry.axes[k]),
                "link_mm": _vector(geometry.links_mm[k]),
                "zero_rad": float(geometry.zeros_rad[k]),
            }
        )
        for k, joint in enumerate(arm.joints)
    )
    effects = adjustment.network.parameters.effects
    values = adjustment.state.arm.amplitudes
    update: dict[str, object] = {
        "effects": arm.effects
        if effects is None
        else tuple(
            effect.model_copy(update=correction.keys)
            for effect, correction in zip(
                arm.effects, effects.at(values).corrections, strict=True
            )
        ),
        "origin_mm": _vector(geometry.origin_mm),
        "joints": joints,
        "identification": None,
    }
    if tuple(arm.probe.vector_mm) != _vector(geometry.probe_vector_mm):
        probe: Probe = arm.probe.model_copy(
            update={"vector_mm": _vector(geometry.probe_vector_mm)}
        )
        update["probe"] = probe
    return arm.model_copy(update=update)


def deviations_of_design(adjustment: Adjustment, design: ArmValues) -> Floats:
    """Return G with G G^T the covariance that undetermined directions have.

    Of the free parameters, (n_free, n_undetermined).

    Strategy: undetermined directions are held at the design's values, so that their
    errors are the design's. They count with its plausible deviation, or with more
    where the determined directions show that this arm is farther from its design: with
    variance zero, lengths would be stated as if the design were exact.
    """
    split, parameters = adjustment.split, adjustment.network.parameters
    to_design = parameters.coordinates(design, adjustment.state.arm)[parameters.free]
    return design_spread(split, to_design) * split.design_deviations


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


def cartesian_covariance(
    adjustment: Adjustment, covariance: Floats
) -> CartesianCovariance:
    """Write the covariance over xyz components."""
    parameters = adjustment.network.parameters
    values = adjustment.state.arm
    geometry, n = values.geometry, parameters.n_joints
    basis = parameters.basis(geometry)
    first, last = 6 * n + 3, 6 * n + 3 + len(values.amplitudes)
    to_xyz = np.zeros((last + 3, len(parameters.names)))
    for k in range(n):
        to_xyz[3 * k : 3 * k + 3, 4 * k : 4 * k + 2] = basis[k].T
        link = 3 * (n + k)
        to_xyz[link : link + 3, 4 * k + 2 : 4 * k + 4] = basis[k].T
    to_xyz[6 * n : 6 * n + 3, 4 * n + 3 : 4 * n + 6] = np.eye(3)
    names_of_effects: tuple[str, ...] = ()
    if parameters.effects is not None:
        to_xyz[first:last, parameters.n_geometric :] = parameters.effects.directions(
            geometry
        )
        names_of_effects = parameters.effects.effects.parameter_names
    to_xyz[last:, 4 * n : 4 * n + 3] = np.eye(3)
    free = to_xyz[:, parameters.free]
    names = parameter_names(adjustment.network.campaign.joint_names, names_of_effects)
    all_values = np.concatenate(
        [
            geometry.axes.ravel(),
            geometry.links_mm.ravel(),
            geometry.probe_vector_mm,
            values.amplitudes,
            geometry.origin_mm,
        ]
    )
    return CartesianCovariance(names, all_values, free @ covariance @ free.T)


def global_test(
    sigma0: float, redundancy: float, *, noise_estimated: bool
) -> GlobalTest:
    """Test sigma0 against 1, two-sided; the redundancy counts independent squares."""
    if redundancy <= 0:
        return GlobalTest(p_value=None, noise_estimated=noise_estimated)
    upper = chi_square_p_value(sigma0**2 * redundancy, redundancy)
    p_value = 2.0 * min(upper, 1.0 - upper)
    return GlobalTest(p_value=p_value, noise_estimated=noise_estimated)


def variance_factor(sigma0: float, test: GlobalTest) -> float:
    """Return the factor between cofactors and covariances.

    One where the noise is known and sigma0 does not contradict it upwards: the
    estimate of sigma0 would only add its own uncertainty. Else sigma0 squared.
    """
    believed = bool(test.passed) or sigma0 < 1.0
    if believed and not test.noise_estimated:
        return 1.0
    return sigma0**2


def artefact_results(
    adjustment: Adjustment, found: PoseStatistics, factor: float, of_design: Floats
) -> tuple[ArtefactResult, ...]:
    """Summarise the result of every artefact, given `deviations_of_design`."""
    network, results = adjustment.network, []
    for at, station in enumerate(network.stations):
        artefact, unknowns = station.artefact, adjustment.state.unknowns[at]
        everyone = np.flatnonzero(network.campaign.poses.artefacts == station.index)
        rms_mm, mean_distance_mm = _sizes(found, station.poses, artefact)
        rms_all_mm, mean_distance_all_mm = _sizes(found, everyone, artefact)
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
                    _estimated_length(adjustment, at, length, factor, of_design)
                    for length in artefact.lengths(unknowns)
                ),
                contact_mm=float(network.noise.contact_mm[station.index]),
                place=artefact.place(unknowns),
            )
        )
    return tuple(results)


def condition_number(adjustment: Adjustment) -> float:
    """Compute that of the arm's column-scaled system, as far as it is determined."""
    columns = adjustment.system.upper[:, :-1]
    if columns.shape[1] == 0 or adjustment.split.n_determined == 0:
        return 1.0
    sizes = np.linalg.norm(columns, axis=0)
    values = np.linalg.svd(columns / np.where(sizes > 0.0, sizes, 1.0))[1]
    return float(values[0] / values[adjustment.split.n_determined - 1])


def _sizes(
    found: PoseStatistics, poses: Integers, artefact: Artefact
) -> tuple[float, float | None]:
    """Return the rms of some misclosures, and of known points the mean length."""
    own_mm = found.misclosures_mm[poses, : artefact.rows_per_pose]
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
    own = length.by_unknowns @ elimination.gain
    arm = own @ elimination.left @ adjustment.split.inverse
    variance_mm2 = float(own @ own + arm @ arm)
    held = own @ elimination.left @ of_design
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


def _vector(values: Sequence[float] | Floats) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
