"""Uncertainty of distances over the working volume of an identified arm.

What the covariance of the parameters means for distances, whatever the datum is.
Directions that the data do not determine are held at their design values and count
as known; noise of every new pose is added.

The first joint turns everything about its axis. Places therefore differ by radius and
height about that axis only, and distances lie along the three directions there.

For ball centres x_1, x_2 and u = (x_1 - x_2) / |x_1 - x_2|

    d|x_1 - x_2| = u^T (A_1 - A_2) dp

with A = dx/dp; the variance follows from the covariance of the parameters p. A
distance does not change when the arm moves as a whole, so neither does its variance
depend on the datum.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import Geometry, across
from traverse.lab.adjustment import Adjustment

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


def nearest_samples(cloud: PostureSample, places_mm: Floats) -> Integers:
    """Find the samples nearest to places after turning the first joint, nearest first.

    Places are (n, 3); the result is (n, N_NEAREST).
    """
    radii, _, heights = _cylindrical(cloud.geometry, places_mm)
    # All ranks by one partition: it is what a map takes longest for.
    return np.stack(
        [
            np.argpartition(
                (cloud.radii_mm - radius) ** 2 + (cloud.heights_mm - height) ** 2,
                range(N_NEAREST),
            )[:N_NEAREST]
            for radius, height in zip(radii, heights, strict=True)
        ]
    )


def postures_reaching(
    cloud: PostureSample, places_mm: Floats, near: Integers
) -> tuple[Floats, Booleans]:
    """Find a posture within the ranges for each place, by Newton steps from a sample.

    Places are (n, 3), samples to start at (n,). Returns readings, (n, n_joints), and
    whether they bring the ball's centre to the place, (n,).
    """
    _, azimuths, _ = _cylindrical(cloud.geometry, places_mm)
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
    return np.stack([*across(geometry.axes[0]), geometry.axes[0]])


DIRECTIONS = ("radial", "tangential", "axial")

_N_RADII, _N_HEIGHTS = 12, 16
# Pairs of postures tried for every distance.
_N_PAIRS = 5
N_NEAREST = _N_PAIRS + 1
_LENGTHS_MM = (500.0, 250.0, 100.0, 50.0, 25.0, 10.0)
# A distance is not longer than this part of the largest radius.
_PART_OF_RADIUS = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class ArmUncertainty:
    """An arm with the covariance of the free parameters of its geometry.

    Effects are left out: their shifts need more than a posture.

    Attributes:
        columns: Gives derivatives (n, 3, n_free) and centres of the ball (n, 3) at
            readings (n, n_joints).
        covariance: (n_free, n_free).
    """

    geometry: Geometry
    columns: Callable[[Floats], tuple[Floats, Floats]]
    covariance: Floats


def arm_uncertainty(adjustment: Adjustment, covariance: Floats) -> ArmUncertainty:
    """Take the geometry's part of a covariance of all free parameters."""
    network, arm = adjustment.network, adjustment.state.arm
    n_free = network.parameters.of_geometry().n_free

    def columns(angles_rad: Floats) -> tuple[Floats, Floats]:
        of_all, centres_mm = network.geometric_columns(arm, angles_rad)
        return of_all[:, :, :n_free], centres_mm

    return ArmUncertainty(arm.geometry, columns, covariance[:n_free, :n_free])


def distance_deviations_mm(
    arm: ArmUncertainty, first_rad: Floats, second_rad: Floats
) -> Floats:
    """Compute standard deviations of distances between the balls of two poses.

    Of readings, (n_pairs, n_joints) each; (n_pairs,).
    """
    by_first, first_mm = arm.columns(first_rad)
    by_second, second_mm = arm.columns(second_rad)
    apart_mm = first_mm - second_mm
    lengths_mm = np.linalg.norm(apart_mm, axis=1, keepdims=True)
    units = apart_mm / np.maximum(lengths_mm, 1e-300)
    slopes = np.einsum("ni,nip->np", units, by_first - by_second)
    variances = np.einsum("np,np->n", slopes @ arm.covariance, slopes)
    deviations_mm: Floats = np.sqrt(np.maximum(variances, 0.0))
    return deviations_mm


@dataclass(frozen=True, slots=True, eq=False)
class UncertaintyMap:
    """Standard deviations by place; NaN where the arm was not, or does not reach.

    Attributes:
        length_mm: Of the distances along the three directions.
        radii_mm: Of places from the first axis, (n_radii,).
        heights_mm: Of places along the first axis from x_0, (n_heights,).
        deviations_mm: Of a distance with its middle at the place, along `DIRECTIONS`,
            then of the distance from the reference to the place; root mean squares
            over postures, (4, n_heights, n_radii).
        reference_mm: The ball's centre at the reference, (3,).
        reference_place_mm: Its radius and height.
    """

    length_mm: float
    radii_mm: Floats
    heights_mm: Floats
    deviations_mm: Floats
    reference_mm: Floats
    reference_place_mm: tuple[float, float]

    def summary(self) -> dict[str, "MapFigures"]:
        """Sum up each of `DIRECTIONS` and `from reference`, where there are places."""
        summaries = {}
        for name, values_mm in zip(
            (*DIRECTIONS, "from reference"), self.deviations_mm, strict=True
        ):
            if not np.any(np.isfinite(values_mm)):
                continue
            row, column = np.unravel_index(np.nanargmax(values_mm), values_mm.shape)
            summaries[name] = MapFigures(
                int(np.count_nonzero(np.isfinite(values_mm))),
                float(np.nanmedian(values_mm)),
                float(np.nanquantile(values_mm, 0.95)),
                float(values_mm[row, column]),
                (float(self.radii_mm[column]), float(self.heights_mm[row])),
            )
        return summaries


@dataclass(frozen=True, slots=True)
class MapFigures:
    """Standard deviations over the volume, in one direction.

    Attributes:
        n_places: That are reached.
        median_mm: Half of the places are better.
        quantile_95_mm: 95 % of the places are better.
        worst_place_mm: Its radius and height.
    """

    n_places: int
    median_mm: float
    quantile_95_mm: float
    largest_mm: float
    worst_place_mm: tuple[float, float]


def uncertainty_map(
    arm: ArmUncertainty, angles_rad: Floats, length_mm: float | None = None
) -> UncertaintyMap:
    """Draw up the map over the volume that was travelled.

    The ranges of the readings, (n_poses, n_joints), say which postures count. Distances
    are 500 mm long by default, or less for a small arm.
    """
    cloud = sample_postures(arm.geometry, angles_rad)
    largest_mm = float(cloud.radii_mm.max())
    radii_mm = _middles(0.0, largest_mm, _N_RADII)
    lowest_mm, highest_mm = float(cloud.heights_mm.min()), float(cloud.heights_mm.max())
    heights_mm = _middles(lowest_mm, highest_mm, _N_HEIGHTS)
    if length_mm is None:
        fitting = [x for x in _LENGTHS_MM if x <= _PART_OF_RADIUS * largest_mm]
        length_mm = fitting[0] if fitting else _LENGTHS_MM[-1]
    places_mm = cloud.place_mm(
        np.tile(radii_mm, _N_HEIGHTS), np.repeat(heights_mm, _N_RADII)
    )
    reference = _middle(cloud)
    reference_mm = cloud.place_mm(
        cloud.radii_mm[reference : reference + 1],
        cloud.heights_mm[reference : reference + 1],
    )[0]
    pairs = [
        (places_mm - 0.5 * length_mm * unit, places_mm + 0.5 * length_mm * unit)
        for unit in cloud.directions
    ]
    pairs.append((np.broadcast_to(reference_mm, places_mm.shape), places_mm))
    deviations_mm = np.stack([_pooled_mm(arm, cloud, *ends) for ends in pairs])
    return UncertaintyMap(
        length_mm,
        radii_mm,
        heights_mm,
        deviations_mm.reshape(4, _N_HEIGHTS, _N_RADII),
        reference_mm,
        (float(cloud.radii_mm[reference]), float(cloud.heights_mm[reference])),
    )


def _middles(least_mm: float, largest_mm: float, n_cells: int) -> Floats:
    """Take the middles of equal cells, (n_cells,)."""
    edges_mm = np.linspace(least_mm, largest_mm, n_cells + 1, dtype=np.float64)
    return 0.5 * (edges_mm[1:] + edges_mm[:-1])


def _pooled_mm(
    arm: ArmUncertainty, cloud: PostureSample, first_mm: Floats, second_mm: Floats
) -> Floats:
    """Average variances between places (n, 3) over pairs of postures, (n,)."""
    sums, counts = np.zeros(len(first_mm)), np.zeros(len(first_mm))
    near_first = nearest_samples(cloud, first_mm)
    near_second = nearest_samples(cloud, second_mm)
    for rank in range(_N_PAIRS):
        first_rad, reached_first = postures_reaching(
            cloud, first_mm, near_first[:, rank]
        )
        # Another rank at the other end, so that the postures differ, too.
        second_rad, reached_second = postures_reaching(
            cloud, second_mm, near_second[:, _N_PAIRS - rank]
        )
        good = reached_first & reached_second
        squares = distance_deviations_mm(arm, first_rad, second_rad) ** 2
        sums += np.where(good, squares, 0.0)
        counts += good
    pooled = np.full(len(first_mm), np.nan)
    some = counts > 0
    pooled[some] = np.sqrt(sums[some] / counts[some])
    return pooled


def _middle(cloud: PostureSample) -> int:
    """Choose a sample in the middle of the volume."""
    places = np.column_stack([cloud.radii_mm, cloud.heights_mm])
    away = np.linalg.norm(places - np.median(places, axis=0), axis=1)
    return int(np.argmin(away))
