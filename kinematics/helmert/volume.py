"""Errors of a Helmert transformation in a volume: its disposition index.

The mean square error of position over a volume is the trace of C M, with C the
covariance of xi and M the mean of J'J over the volume, which has a closed form. With C
of common points that all have the error 1 it says how good their disposition is for
that volume, whatever the residuals are: in the spirit of Benciolini, Vitti and Zatelli
(2016), who judge a net of common points by the errors that it passes on.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import (
    N_RIGID,
    cross_matrices,
    motions,
    skew_vector,
)

_HALVINGS = 200
_ROUNDING = 1e-14


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A box along the axes of its system.

    Attributes:
        low_mm: Corner with the least coordinates, (3,).
        high_mm: The opposite one, (3,).
    """

    low_mm: Floats
    high_mm: Floats

    @property
    def mean_mm(self) -> Floats:
        middle: Floats = 0.5 * (self.low_mm + self.high_mm)
        return middle

    @property
    def moments_mm2(self) -> Floats:
        return np.diag((self.high_mm - self.low_mm) ** 2 / 12.0)

    @property
    def corners_mm(self) -> Floats:
        """(8, 3)."""
        sides = np.stack([self.low_mm, self.high_mm])
        chosen = np.indices((2, 2, 2)).reshape(3, 8)
        return np.stack([sides[chosen[axis], axis] for axis in range(3)], axis=1)

    def farthest_mm(self, curvature: Floats, slope: Floats) -> Floats:
        """Maximise d'Hd + 2 g'd, d from the middle: a corner if H >= 0."""
        away = self.corners_mm - self.mean_mm
        values = np.einsum("ni,ij,nj->n", away, curvature, away) + 2.0 * away @ slope
        # Of corners that are alike the first, whatever rounding says.
        largest = float(np.max(values))
        alike = np.flatnonzero(values >= largest - 1e-9 * abs(largest))
        place: Floats = self.corners_mm[int(alike[0])]
        return place


@dataclass(frozen=True, slots=True, eq=False)
class Ball:
    """All points within a distance of a place.

    Attributes:
        mean_mm: The place, (3,).
    """

    mean_mm: Floats
    radius_mm: float

    @property
    def moments_mm2(self) -> Floats:
        return np.eye(3) * self.radius_mm**2 / 5.0

    @property
    def corners_mm(self) -> Floats:
        """Where it is farthest along its axes, (6, 3)."""
        ways = np.concatenate([np.eye(3), -np.eye(3)])
        return self.mean_mm + self.radius_mm * ways

    def farthest_mm(self, curvature: Floats, slope: Floats) -> Floats:
        """Maximise d'Hd + 2 g'd: (m I - H) d = g with |d| = radius."""
        sizes, vectors = np.linalg.eigh(curvature)
        along = vectors.T @ slope
        largest = float(sizes[-1])
        # |d(m)| falls from m = largest on, so m lies in between these:
        low = largest
        high = largest + float(np.linalg.norm(along)) / self.radius_mm
        if not high > 0.0:  # nothing turns: all places are alike
            first: Floats = self.corners_mm[0]
            return first
        floor = _ROUNDING * high
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            gaps = np.maximum(middle - sizes, floor)
            if float(np.linalg.norm(along / gaps)) > self.radius_mm:
                low = middle
            else:
                high = middle
        away = along / np.maximum(high - sizes, floor)
        left = self.radius_mm**2 - float(away @ away)
        if left > 1e-12 * self.radius_mm**2:  # no slope along the most curved way
            away[-1] += np.copysign(np.sqrt(left), away[-1])
        place: Floats = self.mean_mm + vectors @ away
        return place


Volume = Box | Ball


@dataclass(frozen=True, slots=True, eq=False)
class VolumeError:
    """Errors of position in a volume, as lengths of 3-vectors, one standard deviation.

    Attributes:
        rms_mm: Root mean square over the volume.
        max_at_mm: Where, (3,).
    """

    rms_mm: float
    max_mm: float
    max_at_mm: Floats


def mean_motions(volume: Volume, centre_mm: Floats, n_parameters: int) -> Floats:
    """Compute M, the mean of J'J over a volume, (n_parameters, n_parameters)."""
    away_mm = volume.mean_mm - centre_mm
    second_mm2 = volume.moments_mm2 + np.outer(away_mm, away_mm)
    trace_mm2 = float(np.trace(second_mm2))
    mean = np.zeros((7, 7))
    cross = cross_matrices(away_mm[np.newaxis])[0]
    mean[:3, :3] = np.eye(3)
    mean[:3, 3:6], mean[3:6, :3] = -cross, cross
    mean[:3, 6] = mean[6, :3] = away_mm
    mean[3:6, 3:6] = trace_mm2 * np.eye(3) - second_mm2
    mean[6, 6] = trace_mm2
    return mean[:n_parameters, :n_parameters]


def volume_error(volume: Volume, centre_mm: Floats, covariance: Floats) -> VolumeError:
    """Compute errors in a volume by the covariance of xi.

    Args:
        volume: in the target system.
        centre_mm: reference point of xi, (3,).
        covariance: of xi, (p, p).
    """
    n_parameters = len(covariance)
    mean = mean_motions(volume, centre_mm, n_parameters)
    rms_mm = float(np.sqrt(max(float(np.sum(covariance * mean)), 0.0)))
    # The trace of J C J' is a quadratic form of d = y - c.
    turns, mixed = covariance[3:6, 3:6], covariance[:3, 3:6]
    growth = float(covariance[6, 6]) if n_parameters > N_RIGID else 0.0
    curvature = (float(np.trace(turns)) + growth) * np.eye(3) - turns
    slope = skew_vector(mixed)
    if n_parameters > N_RIGID:
        slope = slope + covariance[:3, 6]
    from_middle = slope + curvature @ (volume.mean_mm - centre_mm)
    at_mm = volume.farthest_mm(curvature, from_middle)
    covariance_mm2 = place_covariances(at_mm[np.newaxis], centre_mm, covariance)[0]
    return VolumeError(
        rms_mm, float(np.sqrt(max(np.trace(covariance_mm2), 0.0))), at_mm
    )


def place_covariances(
    places_mm: Floats, centre_mm: Floats, covariance: Floats
) -> Floats:
    """Compute J C J' at places (n, 3) of the target system: (n, 3, 3)."""
    design = motions(places_mm - centre_mm, len(covariance))
    covariances_mm2: Floats = design @ covariance @ np.swapaxes(design, 1, 2)
    return covariances_mm2


def disposition_index(
    points_mm: Floats, volume: Volume, *, with_scale: bool = False
) -> VolumeError:
    """Compute errors in a volume per error of a common point.

    1 means that places in the volume are as uncertain as a common point is.

    Args:
        points_mm: in the target system, (n, 3); they have to determine the
            transformation.
        volume: in the same system.
        with_scale: as it will be adjusted.
    """
    centre_mm = points_mm.mean(axis=0)
    design = motions(points_mm - centre_mm, N_RIGID + int(with_scale))
    normal = np.einsum("nip,niq->pq", design, design)
    error = volume_error(volume, centre_mm, np.linalg.inv(normal))
    # Both as root mean squares of a 3-vector's length: a point's is sqrt(3).
    unit = np.sqrt(3.0)
    return VolumeError(error.rms_mm / unit, error.max_mm / unit, error.max_at_mm)
