"""Postures within travelled ranges, and which of them bring the ball to a place."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import Geometry

_N_SAMPLES = 4000
_SEED = 20_170_112
_STEPS = 12
_REACHED_MM = 0.5
_MARGIN_RAD = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class PostureSample:
    """Random postures within ranges; the first joint is in the middle of its own.

    Attributes:
        least_rad: Smallest readings, (n_joints,).
        largest_rad: Largest readings, (n_joints,).
        angles_rad: Readings, (n_samples, n_joints).
        radii_mm: Of the ball from the first axis, (n_samples,).
        heights_mm: Of the ball along the first axis from x_0, (n_samples,).
        azimuths_rad: Of the ball about the first axis, (n_samples,).
    """

    geometry: Geometry
    least_rad: Floats
    largest_rad: Floats
    angles_rad: Floats
    radii_mm: Floats
    heights_mm: Floats
    azimuths_rad: Floats

    @property
    def azimuth_rad(self) -> float:
        """The mean azimuth, around which the first joint can turn both ways."""
        return float(np.angle(np.mean(np.exp(1j * self.azimuths_rad))))

    def place_mm(self, radii_mm: Floats, heights_mm: Floats) -> Floats:
        """Turn radii and heights (n,) into places at the mean azimuth, (n, 3)."""
        radial, _, axial = self.directions
        places_mm: Floats = (
            self.geometry.origin_mm
            + radii_mm[:, np.newaxis] * radial
            + heights_mm[:, np.newaxis] * axial
        )
        return places_mm

    @property
    def directions(self) -> Floats:
        """Radial, tangential, axial unit vectors at the mean azimuth, (3, 3)."""
        first, second, axial = _frame(self.geometry)
        cosine, sine = np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)
        return np.stack(
            [
                cosine * first + sine * second,
                cosine * second - sine * first,
                axial,
            ]
        )


def sample_postures(geometry: Geometry, angles_rad: Floats) -> PostureSample:
    """Draw postures within the ranges of some readings, (n_poses, n_joints)."""
    least_rad, largest_rad = angles_rad.min(axis=0), angles_rad.max(axis=0)
    rng = np.random.default_rng(_SEED)
    drawn_rad = rng.uniform(least_rad, largest_rad, (_N_SAMPLES, len(least_rad)))
    drawn_rad[:, 0] = 0.5 * (least_rad[0] + largest_rad[0])
    radii, azimuths, heights = _cylindrical(geometry, probe_centre(geometry, drawn_rad))
    return PostureSample(
        geometry, least_rad, largest_rad, drawn_rad, radii, heights, azimuths
    )


def postures_reaching(
    cloud: PostureSample, places_mm: Floats, rank: int
) -> tuple[Floats, Booleans]:
    """Find a posture within the ranges for each place.

    Start at the sample nearest after turning the first joint, then Newton steps.

    Args:
        cloud: Of the arm.
        places_mm: For the ball's centre, (n, 3).
        rank: 0 starts at the nearest sample, 1 at the second nearest, ...

    Returns:
        Readings, (n, n_joints), and whether they reach the place, (n,).
    """
    radii, azimuths, heights = _cylindrical(cloud.geometry, places_mm)
    near = np.array(
        [
            np.argpartition(
                (cloud.radii_mm - radius) ** 2 + (cloud.heights_mm - height) ** 2, rank
            )[rank]
            for radius, height in zip(radii, heights, strict=True)
        ]
    )
    angles_rad = cloud.angles_rad[near].copy()
    turns_rad = azimuths - cloud.azimuths_rad[near]
    angles_rad[:, 0] += np.angle(np.exp(1j * turns_rad))
    least_rad = cloud.least_rad - _MARGIN_RAD
    largest_rad = cloud.largest_rad + _MARGIN_RAD
    for _ in range(_STEPS):
        derivatives = probe_derivatives(cloud.geometry, angles_rad)
        away_mm = places_mm - derivatives.centres_mm
        slopes = derivatives.by_angles
        # Keeps steps bounded where the arm is stretched; places need no more.
        square = slopes @ slopes.swapaxes(1, 2) + np.eye(3)
        solved = np.linalg.solve(square, away_mm[:, :, np.newaxis])
        step = (slopes.swapaxes(1, 2) @ solved)[:, :, 0]
        angles_rad = np.clip(
            angles_rad + np.clip(step, -0.3, 0.3), least_rad, largest_rad
        )
    away_mm = places_mm - probe_centre(cloud.geometry, angles_rad)
    return angles_rad, np.linalg.norm(away_mm, axis=1) < _REACHED_MM


def _cylindrical(
    geometry: Geometry, centres_mm: Floats
) -> tuple[Floats, Floats, Floats]:
    """Write places (n, 3) as radius, azimuth, height about the first axis, (n,)."""
    first, second, axial = _frame(geometry)
    from_origin_mm = centres_mm - geometry.origin_mm
    x_mm, y_mm = from_origin_mm @ first, from_origin_mm @ second
    return np.hypot(x_mm, y_mm), np.arctan2(y_mm, x_mm), from_origin_mm @ axial


def _frame(geometry: Geometry) -> Floats:
    """Take two unit vectors across the first axis, and the axis, (3, 3)."""
    axial = geometry.axes[0]
    across = np.eye(3)[int(np.argmin(np.abs(axial)))]
    first = across - (across @ axial) * axial
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(axial, first), axial])
