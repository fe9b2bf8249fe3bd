"""Result of an adjustment: the arm, its parameters, its artefacts, in figures."""

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.lab.adjustment import Adjustment, ArmValues, PoseStatistics
from traverse.lab.artefacts.artefact import Artefact, Length
from traverse.lab.identification.results.result import (
    ArtefactResult,
    EstimatedLength,
    ParameterEstimate,
)

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
