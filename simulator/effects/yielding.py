"""How far everything yields, and the arm that has yielded: still rigid motions.

    T_k = T_(k-1) shift_k tilt_k exp(S_k (theta_k + twist_k)) growth_k
    T_0 = the base's shift, and its tilt about the first joint's origin

each factor a 4x4 matrix in the base posture of the body that it acts on.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.arm.physics import turn_matrices
from traverse.simulator.effects.posture import Build


@dataclass(frozen=True, slots=True)
class Deflection:
    """Small motions, added up by faults in place.

    Attributes:
        twists_rad: (n, n_joints) about the axes.
        tilts_rad: (n_joints, n, 3) rotation vectors about the joints' origins, as the
            body that carries the joint had them in the base posture.
        shifts_mm: (n_joints, n, 3) of the joints' origins, likewise.
        growths: (n, n_joints) of the elements, over their lengths.
        base_tilts_rad: (n, 3)
        base_shifts_mm: (n, 3)
    """

    twists_rad: Floats
    tilts_rad: Floats
    shifts_mm: Floats
    growths: Floats
    base_tilts_rad: Floats
    base_shifts_mm: Floats


def no_yielding(n_samples: int, n_joints: int) -> Deflection:
    """Nothing has yielded yet."""
    return Deflection(
        twists_rad=np.zeros((n_samples, n_joints)),
        tilts_rad=np.zeros((n_joints, n_samples, 3)),
        shifts_mm=np.zeros((n_joints, n_samples, 3)),
        growths=np.zeros((n_samples, n_joints)),
        base_tilts_rad=np.zeros((n_samples, 3)),
        base_shifts_mm=np.zeros((n_samples, 3)),
    )


def deflected_motion(build: Build, turns_rad: Floats, yielding: Deflection) -> Floats:
    """Motion (n, 4, 4) of the last element from the base posture."""
    origins_mm = build.mechanism.origins_mm
    motion = tilt_matrices(origins_mm[0], yielding.base_tilts_rad)
    motion[:, :3, 3] += yielding.base_shifts_mm
    for k, axis in enumerate(build.mechanism.axes):
        if np.any(yielding.shifts_mm[k]):
            _displace(motion, yielding.shifts_mm[k])
        if np.any(yielding.tilts_rad[k]):
            motion = motion @ tilt_matrices(origins_mm[k], yielding.tilts_rad[k])
        turned_rad = turns_rad[:, k] + yielding.twists_rad[:, k]
        motion = motion @ turn_matrices(axis, origins_mm[k], turned_rad)
        if np.any(yielding.growths[:, k]):
            _displace(motion, yielding.growths[:, k, None] * build.links_mm[k])
    return motion


def tilt_matrices(origin_mm: Floats, tilts_rad: Floats) -> Floats:
    """Turns (n, 4, 4) about a point by rotation vectors (n, 3)."""
    matrices = np.zeros((len(tilts_rad), 4, 4))
    x, y, z = tilts_rad.T
    cross = np.zeros((len(tilts_rad), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross[:, 1, 0], cross[:, 2, 0], cross[:, 2, 1] = z, -y, x
    angles_rad = np.sqrt(x * x + y * y + z * z)[:, None, None]
    sines = np.sinc(angles_rad / np.pi)
    versines = 0.5 * np.sinc(angles_rad / (2.0 * np.pi)) ** 2
    turned = np.eye(3) + sines * cross + versines * (cross @ cross)
    matrices[:, :3, :3] = turned
    matrices[:, :3, 3] = origin_mm - turned @ origin_mm
    matrices[:, 3, 3] = 1.0
    return matrices


def _displace(motions: Floats, shifts_mm: Floats) -> None:
    """Shift what is carried by (n, 3), as the carrier had it in the base posture."""
    motions[:, :3, 3] += np.einsum("nij,nj->ni", motions[:, :3, :3], shifts_mm)
