"""Positions of the arm's parts: rigid at given turns, and after all deflections.

    T_k = T_(k-1) shift_k tilt_k exp(S_k (theta_k + twist_k)) growth_k
    T_0 = the base's shift, and its tilt about the first joint's origin

each factor a 4x4 matrix in the base posture of the body that it acts on.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from traverse.arrays import Floats, Indices
from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.arm.physics import Mechanism, body_motions, turn_matrices
from traverse.simulator.arm.truth import gearing_of


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Conditions that a fault may depend on; one sample a row.

    Attributes:
        time_s: (n,) since the campaign or the script began.
        utc_s: (n,) since 1970, or None if unknown.
        temperature_c: (n,) of the whole arm.
        speed_rad_s: (n, n_joints) of the encoders.
        approach: (n, n_joints) -1, 0, +1: sign of the last motion.
        towards: (n, 3) unit vectors from the ball towards the material; NaN without
            contact or in a seat.
        force_n: (n,) of the contact.
    """

    time_s: Floats
    utc_s: Floats | None
    temperature_c: Floats
    speed_rad_s: Floats
    approach: Floats
    towards: Floats
    force_n: Floats

    def since_s(self, epoch_utc_s: float) -> Floats:
        """Return seconds (n,) since a moment.

        Raises:
            ValueError: the time is unknown.
        """
        if self.utc_s is None:
            raise ValueError(
                "an effect counts from its epoch_utc, but the start in UTC is unknown"
            )
        return self.utc_s - epoch_utc_s

    def part(self, rows: slice | Indices) -> "Surroundings":
        columns = {field.name: getattr(self, field.name) for field in fields(self)}
        known = {name: c[rows] for name, c in columns.items() if c is not None}
        return replace(self, **known)


M_PER_MM = 1e-3


@dataclass(frozen=True, slots=True)
class Build:
    """The true arm with its masses, in the base posture.

    Attributes:
        zeros_rad: (n_joints,) readings in the base posture.
        links_mm: (n_joints, 3) from each joint's origin to the next one's.
        masses_kg: (n_joints + 1,) of the elements and, last, of the probe; 0 if the
            arm file states none.
        centres_mm: (n_joints + 1, 3) of those masses; the probe's at the ball.
        gravity_m_s2: (3,)
        first_moments_kg_m: (n_joints, 3) besides those masses: mass times distance
            from the joint's origin, of the element and all beyond it.
        gearing: (n_joints, n_joints) turns of the hinges by turns of the encoders.
    """

    mechanism: Mechanism
    zeros_rad: Floats
    links_mm: Floats
    masses_kg: Floats
    centres_mm: Floats
    gravity_m_s2: Floats
    first_moments_kg_m: Floats
    gearing: Floats

    def encoders_of(self, hinges: Floats) -> Floats:
        """Convert turns or rates of hinges to encoders', (n, n_joints)."""
        return np.asarray(np.linalg.solve(self.gearing, hinges.T).T, dtype=np.float64)


def build_of(
    arm: Arm, mechanism: Mechanism, zeros_rad: Floats, first_moments_kg_m: Floats
) -> Build:
    """Add the masses and first moments of an arm file to the true geometry."""
    origins_mm = mechanism.origins_mm
    end_mm = mechanism.probe_mm - np.array(arm.probe.vector_mm)
    links_mm = np.diff(np.vstack([origins_mm, end_mm]), axis=0)
    centres_mm = np.vstack([origins_mm + 0.5 * links_mm, mechanism.probe_mm])
    for k, joint in enumerate(arm.joints):
        if joint.centre_of_mass_mm is not None:
            centres_mm[k] = origins_mm[k] + np.array(joint.centre_of_mass_mm)
    masses = [*(joint.mass_kg for joint in arm.joints), arm.probe.mass_kg]
    return Build(
        mechanism=mechanism,
        zeros_rad=zeros_rad,
        links_mm=links_mm,
        masses_kg=np.array([mass or 0.0 for mass in masses]),
        centres_mm=centres_mm,
        gravity_m_s2=np.array(arm.reference.gravity_m_s2, dtype=np.float64),
        first_moments_kg_m=first_moments_kg_m,
        gearing=gearing_of(arm),
    )


@dataclass(frozen=True)
class Posture:
    """The rigid arm at given turns; values are computed once.

    Attributes:
        turns_rad: (n, n_joints) from the base posture.
    """

    build: Build
    turns_rad: Floats
    around: Surroundings

    @cached_property
    def motions(self) -> Floats:
        """Motions of all bodies from the base posture, (n, n_joints + 1, 4, 4)."""
        return body_motions(self.build.mechanism, self.turns_rad)

    @cached_property
    def moments_nm(self) -> Floats:
        """Moments of all weights beyond each joint about its origin, (n, n_joints, 3).

        Every mass acts at its present place, (p - o) x m g.
        """
        n_joints = self.build.mechanism.n_joints
        carriers = [*range(1, n_joints + 1), n_joints]  # the last one has the probe
        places_mm = moved_points(self.motions[:, carriers], self.build.centres_mm)
        origins_mm = moved_points(self.motions[:, :-1], self.build.mechanism.origins_mm)
        weighted = self.build.masses_kg[:, None] * places_mm
        beyond = np.cumsum(weighted[:, ::-1], axis=1)[:, ::-1]
        masses_kg = np.cumsum(self.build.masses_kg[::-1])[::-1]
        lever_kg_mm = beyond[:, :-1] - masses_kg[:-1, None] * origins_mm
        lever_kg_m = M_PER_MM * lever_kg_mm
        for element, first_kg_m in enumerate(self.build.first_moments_kg_m):
            turned = self.motions[:, element + 1, :3, :3] @ first_kg_m
            lever_kg_m[:, : element + 1] += turned[:, None]
        moments: Floats = np.cross(lever_kg_m, self.build.gravity_m_s2)
        return moments

    def axis(self, joint: int) -> Floats:
        """Return the direction of a joint's axis, (n, 3)."""
        pointing: Floats = (
            self.motions[:, joint, :3, :3] @ self.build.mechanism.axes[joint]
        )
        return pointing

    def in_carrier(self, vectors: Floats, joint: int) -> Floats:
        """Rotate vectors (n, 3) back to the base posture of a joint's carrier."""
        turned = self.motions[:, joint, :3, :3]
        brought: Floats = np.einsum("mij,mi->mj", turned, vectors)
        return brought


def moved_points(motions: Floats, points_mm: Floats) -> Floats:
    """Move points (m, 3) by their own motions (n, m, 4, 4): (n, m, 3)."""
    turned = (motions[..., :3, :3] @ points_mm[:, :, None])[..., 0]
    moved: Floats = turned + motions[..., :3, 3]
    return moved


@dataclass(frozen=True, slots=True)
class Deflection:
    """Small motions, added up by faults in place.

    Attributes:
        twists_rad: (n, n_joints) about the axes.
        tilts_rad: (n_joints, n, 3) rotation vectors about the joints' origins, in the
            carrier's base posture.
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
    return Deflection(
        twists_rad=np.zeros((n_samples, n_joints)),
        tilts_rad=np.zeros((n_joints, n_samples, 3)),
        shifts_mm=np.zeros((n_joints, n_samples, 3)),
        growths=np.zeros((n_samples, n_joints)),
        base_tilts_rad=np.zeros((n_samples, 3)),
        base_shifts_mm=np.zeros((n_samples, 3)),
    )


def deflected_motion(build: Build, turns_rad: Floats, yielding: Deflection) -> Floats:
    """Return the motion (n, 4, 4) of the last element from the base posture."""
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
    """Return rotations (n, 4, 4) about a point by rotation vectors (n, 3)."""
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
    """Shift the carried parts by (n, 3), in the carrier's base posture."""
    motions[:, :3, 3] += np.einsum("nij,nj->ni", motions[:, :3, :3], shifts_mm)
