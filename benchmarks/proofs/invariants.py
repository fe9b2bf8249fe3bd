"""What any correct identification must predict, whatever its datum: distances.

The distance of the ball between two postures does not depend on where the base
stands, nor on how parameters share a shift. What was estimated is compared with the
simulator's own matrices, whitened with the covariance that the identification states;
derivatives of distances are differences of distances, not the adjustment's own.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.forward import probe_centre
from traverse.lab.identification.equations.parameters import ArmValues
from traverse.lab.identification.results.result import Identification
from traverse.simulator.arm.physics import probe_pose
from traverse.simulator.campaigns import PoseSet

# More than there are parameters, so that every combination of them is looked at.
N_PAIRS = 60
_DIFFERENCE = 1e-3  # of a parameter's plausible deviation
_NEAREST_MM = 100.0
_LEAST_SIZE = 1e-7  # of the largest: smaller ones are rounding


@dataclass(frozen=True, slots=True, eq=False)
class DistanceErrors:
    """Predicted less true distances.

    Attributes:
        errors_mm: (n_pairs,); without a length, of distances in units of their mean.
        chi_square: Of the errors, whitened by the stated cofactors and sigma0 = 1.
        degrees: Of freedom.
        foreseen: Chi-square of the errors that follow from foreseen steps, or NaN.
    """

    errors_mm: Floats
    chi_square: float
    degrees: int
    foreseen: float


def distance_errors(
    result: Identification,
    poses: PoseSet,
    seed: int,
    *,
    has_scale: bool = True,
    steps: Floats | None = None,
) -> DistanceErrors:
    """Compare predicted distances between random posture pairs with the truth.

    Args:
        result: What was identified.
        poses: Where the true arm and its limits are.
        seed: Of the posture pairs.
        has_scale: Whether the campaign has a length; else shapes are compared.
        steps: By which the free parameters are foreseen to be off, (n_free,).
    """
    rng = np.random.default_rng([seed, 0x696E76])
    least, largest = poses.limits_rad.T
    turns_rad = rng.uniform(least, largest, (4 * N_PAIRS, len(least)))
    # The direction of a short distance, and so its error, is not linear in the steps.
    apart_mm = _distances(probe_pose(poses.truth.mechanism, turns_rad)[0])
    far = np.flatnonzero(apart_mm >= _NEAREST_MM)[:N_PAIRS]
    turns_rad = turns_rad.reshape(-1, 2, len(least))[far].reshape(-1, len(least))
    angles_rad = turns_rad + poses.truth.zeros_rad
    true_mm = _distances(probe_pose(poses.truth.mechanism, turns_rad)[0])
    adjustment = result.adjustment
    parameters, estimate = adjustment.network.parameters, adjustment.state.arm

    def predicted_mm(values: ArmValues) -> Floats:
        return _distances(probe_centre(values.geometry, angles_rad))

    slopes = np.empty((N_PAIRS, parameters.n_free))
    for at, tolerance in enumerate(parameters.free_tolerances):
        step = np.zeros(parameters.n_free)
        step[at] = _DIFFERENCE * tolerance
        ahead = predicted_mm(parameters.moved(estimate, step))
        behind = predicted_mm(parameters.moved(estimate, -step))
        slopes[:, at] = (ahead - behind) / (2.0 * step[at])
    found_mm = predicted_mm(estimate)
    errors_mm = found_mm - true_mm
    if not has_scale:
        mean_mm = float(true_mm.mean())
        errors_mm = mean_mm * (np.log(found_mm) - np.log(true_mm))
        slopes = mean_mm * slopes / found_mm[:, np.newaxis]
        errors_mm = errors_mm - errors_mm.mean()
        slopes = slopes - slopes.mean(axis=0)
    spread = slopes @ adjustment.split.inverse
    left, sizes, _ = np.linalg.svd(spread, full_matrices=False)
    seen = sizes > _LEAST_SIZE * np.max(sizes, initial=0.0)
    white = (left.T @ errors_mm)[seen] / sizes[seen]
    foreseen = np.nan
    if steps is not None:
        expected = (left.T @ (slopes @ steps))[seen] / sizes[seen]
        foreseen = float(expected @ expected)
    return DistanceErrors(errors_mm, float(white @ white), len(white), foreseen)


def _distances(centres_mm: Floats) -> Floats:
    """Distances of consecutive pairs, (n / 2,)."""
    distances: Floats = np.linalg.norm(centres_mm[::2] - centres_mm[1::2], axis=1)
    return distances
