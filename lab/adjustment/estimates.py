"""What an adjustment gives: the arm, its covariance, the global test."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm, Probe
from traverse.kinematics.uncertainty.arm_covariance import parameter_names
from traverse.lab.adjustment.parameters import ArmValues, Parameters
from traverse.lab.adjustment.solve import Adjustment, design_spread
from traverse.lab.outcomes.covariance import CartesianCovariance
from traverse.lab.statistics.distributions import GlobalTest, chi_square_p_value


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


def _vector(values: Sequence[float] | Floats) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


# Components smaller than this part of the largest are not named.
_NAMED = 0.1


def named(parameters: Parameters, direction: Floats) -> dict[str, float]:
    """Name the larger components of a direction of the free ones, largest first."""
    least = _NAMED * float(np.max(np.abs(direction)))
    order = np.argsort(-np.abs(direction))
    names = parameters.free_names
    return {
        names[at]: float(direction[at]) for at in order if abs(direction[at]) >= least
    }


# Part of what is assumed up to which a combination counts as determined.
_DETERMINED = 0.5


def mass_distribution(adjustment: Adjustment) -> dict[str, Any]:
    """Say what was estimated of masses, as reports and JSON files have it.

    Combinations are those of the covariance over the assumed variances, their `std` a
    part of the assumed one; empty where no first moment was estimated for want of
    masses.
    """
    parameters = adjustment.network.parameters
    model = parameters.effects
    if model is None or model.assumed is None:
        return {}
    is_moment = np.zeros(len(parameters.names), dtype=np.bool_)
    is_moment[parameters.n_geometric :][model.moments] = True
    is_free = parameters.free[is_moment]
    if not np.any(is_free):
        return {}
    joints = model.effects.joint_names
    moments = model.at(adjustment.state.arm.amplitudes).first_moments
    stds_kg_m = model.assumed.stds_of(moments)[is_free]
    own = is_moment[parameters.free]
    white = adjustment.split.inverse[own] / stds_kg_m[:, np.newaxis]
    squares, directions = np.linalg.eigh(white @ white.T)
    combinations = np.zeros((len(squares), parameters.n_free))
    combinations[:, own] = directions.T
    return {
        "assumed_mass_kg": model.assumed.mass_kg,
        "first_moments_kg_m": {joints[m.joints.start]: m.values for m in moments},
        "determined": [
            {"direction": named(parameters, combination), "std": float(np.sqrt(square))}
            for square, combination in zip(squares, combinations, strict=True)
            if square < _DETERMINED**2
        ],
        "combinations": len(squares),
    }
