"""Standard deviations of distances between the balls of two poses.

For ball centres x_1, x_2 and u = (x_1 - x_2) / |x_1 - x_2|

    d|x_1 - x_2| = u^T (A_1 - A_2) dp

with A = dx/dp; the variance follows from the covariance of the parameters p. A
distance does not change when the arm moves as a whole, so neither does its variance
depend on the datum.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.campaign.campaign import Poses
from traverse.lab.identification.equations.parameters import ArmValues, Parameters


@dataclass(frozen=True, slots=True, eq=False)
class ArmUncertainty:
    """An arm with the covariance of its free parameters.

    Attributes:
        geometry: As estimated.
        parameters: Of the geometry only; with the mask of the free ones.
        covariance: (n_free, n_free).
    """

    geometry: Geometry
    parameters: Parameters
    covariance: Floats


def arm_uncertainty(
    arm: ArmValues, parameters: Parameters, covariance: Floats
) -> ArmUncertainty:
    """Leave effects out: their shifts need more than a posture."""
    geometric = parameters.of_geometry()
    n_free = geometric.n_free
    return ArmUncertainty(arm.geometry, geometric, covariance[:n_free, :n_free])


def distance_deviations_mm(
    arm: ArmUncertainty, first_rad: Floats, second_rad: Floats
) -> Floats:
    """Compute standard deviations of distances between the balls of two poses.

    Args:
        arm: With its covariance.
        first_rad: Readings, (n_pairs, n_joints).
        second_rad: Readings, (n_pairs, n_joints).

    Returns:
        (n_pairs,).
    """
    first_mm, by_first = _columns(arm, first_rad)
    second_mm, by_second = _columns(arm, second_rad)
    apart_mm = first_mm - second_mm
    lengths_mm = np.linalg.norm(apart_mm, axis=1, keepdims=True)
    units = apart_mm / np.maximum(lengths_mm, 1e-300)
    slopes = np.einsum("ni,nip->np", units, by_first - by_second)
    variances = np.einsum("np,np->n", slopes @ arm.covariance, slopes)
    deviations_mm: Floats = np.sqrt(np.maximum(variances, 0.0))
    return deviations_mm


def noise_deviations_mm(
    geometry: Geometry,
    encoder_rad: Floats,
    contact_mm: float,
    first_rad: Floats,
    second_rad: Floats,
) -> Floats:
    """Compute what the noise of readings (n_joints,) and contacts adds to distances.

    Args:
        geometry: The arm.
        encoder_rad: Standard deviations of the readings, (n_joints,).
        contact_mm: Standard deviation of a contact along the distance.
        first_rad: Readings, (n_pairs, n_joints).
        second_rad: Readings, (n_pairs, n_joints).

    Returns:
        (n_pairs,).
    """
    first = probe_derivatives(geometry, first_rad)
    second = probe_derivatives(geometry, second_rad)
    apart_mm = first.centres_mm - second.centres_mm
    units = apart_mm / np.linalg.norm(apart_mm, axis=1, keepdims=True)
    variances = np.full(len(units), 2.0 * contact_mm**2)
    for end in (first, second):
        slopes = np.einsum("ni,nij->nj", units, end.by_angles) * encoder_rad
        variances += np.einsum("nj,nj->n", slopes, slopes)
    deviations_mm: Floats = np.sqrt(variances)
    return deviations_mm


def _columns(arm: ArmUncertainty, angles_rad: Floats) -> tuple[Floats, Floats]:
    """Compute centres (n, 3) and derivatives by free parameters (n, 3, n_free)."""
    derivatives = probe_derivatives(arm.geometry, angles_rad)
    n_poses = len(angles_rad)
    nothing = np.zeros(n_poses, dtype=np.int64)
    poses = Poses(nothing, np.zeros(n_poses), nothing, nothing, angles_rad)
    values = ArmValues(arm.geometry, np.empty(0))
    return derivatives.centres_mm, arm.parameters.columns(values, derivatives, poses)
