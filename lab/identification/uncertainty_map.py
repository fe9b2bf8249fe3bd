"""How well an identified arm knows distances, over its working volume.

For two poses with ball centres x_1, x_2 and u = (x_1 - x_2) / |x_1 - x_2|

    d|x_1 - x_2| = u^T (A_1 - A_2) dp        variance u^T (A_1 - A_2) C (...)^T u

with A = dx/dp and the covariance C of the parameters p. A distance does not change
when the arm moves as a whole, so its variance does not depend on the datum.

The first joint turns everything about its axis, so that places differ by radius and
height about that axis only: the map is drawn in this half plane, and distances lie
along its three directions. Directions that the data do not determine are held at
their design values and count as known.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.geometry import Geometry
from lab.identification.cylinder import cylinder_about_first_axis
from lab.identification.parameters import ArmValues, Parameters
from lab.identification.reaching import posture_cloud

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

DIRECTIONS = ("radial", "tangential", "axial")
_LENGTH_MM = 500.0
_N_RADII, _N_HEIGHTS = 12, 16
# Postures tried for each end of a distance.
_N_POSTURES = 4


@dataclass(frozen=True, slots=True, eq=False)
class UncertaintyMap:
    """Standard deviations of distances by place; NaN where the arm does not reach.

    Attributes:
        length_mm: Of the distances along the three directions.
        radii_mm: Middles of the cells, from the first axis, (n_radii,).
        heights_mm: Middles of the cells, along the first axis from x_0, (n_heights,).
        by_direction_mm: Of a distance with its middle in the cell; directions as in
            `DIRECTIONS`; root mean square over postures, (3, n_heights, n_radii).
        reference_mm: Where the reference is, (3,).
        from_reference_mm: Of the distance to the reference; root mean square over
            postures, (n_heights, n_radii).
    """

    length_mm: float
    radii_mm: Floats
    heights_mm: Floats
    by_direction_mm: Floats
    reference_mm: Floats
    from_reference_mm: Floats


@dataclass(frozen=True, slots=True, eq=False)
class KnownArm:
    """An arm with the covariance of its free parameters.

    Attributes:
        geometry: As estimated.
        parameters: With the mask of the free ones; terms are left out.
        covariance: Of the free parameters without the terms', (n_free, n_free).
    """

    geometry: Geometry
    parameters: Parameters
    covariance: Floats


def known_arm(arm: ArmValues, parameters: Parameters, covariance: Floats) -> KnownArm:
    """Leave terms out: their shifts need more than a posture."""
    geometric = parameters.without_terms()
    n_free = geometric.n_free
    return KnownArm(arm.geometry, geometric, covariance[:n_free, :n_free])


def distance_deviations_mm(
    arm: KnownArm, first_rad: Floats, second_rad: Floats
) -> Floats:
    """Compute standard deviations of distances between two poses.

    Args:
        arm: With its covariance.
        first_rad: Readings, (n_pairs, n_joints).
        second_rad: Readings, (n_pairs, n_joints).

    Returns:
        (n_pairs,) [mm].
    """
    first_mm, by_first = _columns(arm, first_rad)
    second_mm, by_second = _columns(arm, second_rad)
    apart_mm = first_mm - second_mm
    units = apart_mm / np.linalg.norm(apart_mm, axis=1, keepdims=True)
    slopes = np.einsum("ni,nip->np", units, by_first - by_second)
    variances = np.einsum("np,pq,nq->n", slopes, arm.covariance, slopes)
    deviations_mm: Floats = np.sqrt(np.maximum(variances, 0.0))
    return deviations_mm


def uncertainty_map(
    arm: KnownArm, angles_rad: Floats, length_mm: float | None = None
) -> UncertaintyMap:
    """Draw up the map over the volume that was travelled.

    Args:
        arm: With its covariance.
        angles_rad: Readings of a campaign, whose ranges say which postures count,
            (n_poses, n_joints).
        length_mm: Of the distances; default 500 mm, or a round length that fits three
            times into a smaller volume.
    """
    cloud = posture_cloud(arm.geometry, angles_rad)
    cylinder = cylinder_about_first_axis(arm.geometry)
    radii, heights = cylinder.radii_and_heights_mm(cloud.centres_mm)
    radius_edges = np.linspace(0.0, float(radii.max()), _N_RADII + 1)
    height_edges = np.linspace(
        float(heights.min()), float(heights.max()), _N_HEIGHTS + 1
    )
    if length_mm is None:
        extent_mm = min(radius_edges[-1], height_edges[-1] - height_edges[0])
        length_mm = _suitable_length_mm(float(extent_mm))
    radii_mm = 0.5 * (radius_edges[1:] + radius_edges[:-1])
    heights_mm = 0.5 * (height_edges[1:] + height_edges[:-1])
    azimuth_rad = cylinder.middle_azimuth_rad(cloud.centres_mm)
    shape = (_N_HEIGHTS, _N_RADII)
    by_direction = np.full((3, *shape), np.nan)
    places = [
        (row, column, cylinder.place_mm(radius, height, azimuth_rad))
        for row, height in enumerate(heights_mm)
        for column, radius in enumerate(radii_mm)
    ]
    axes = cylinder.directions(azimuth_rad)
    for at, direction in enumerate(axes):
        half_mm = 0.5 * length_mm * direction
        middles_mm = np.array([place for _, _, place in places])
        pooled = _pooled_mm(arm, cloud, middles_mm + half_mm, middles_mm - half_mm)
        for (row, column, _), value in zip(places, pooled, strict=True):
            by_direction[at, row, column] = value
    reference = int(np.argmin(np.linalg.norm(_scaled(cloud.centres_mm), axis=1)))
    from_reference = _binned_mm(arm, cloud, reference, radius_edges, height_edges)
    return UncertaintyMap(
        length_mm,
        radii_mm,
        heights_mm,
        by_direction,
        cloud.centres_mm[reference],
        from_reference,
    )
