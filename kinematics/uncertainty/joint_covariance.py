"""Covariance between points of one arm, and lengths with their uncertainty.

Errors of an arm's parameters are the same for all its points. With S_i = A_i F of point
i (C_p = F F^T, see `arm_covariance`) and its own covariance C_i,

    cov(x_i, x_j) = S_i S_j^T,  i != j;      cov(x_i, x_i) = C_i.

Noise of encoders and contacts is each point's own. So is taken what a correction beyond
the range that the arm was seen in leaves open: between points that share such a
correction a length is stated too uncertain, or too certain where it turns by more than
a right angle between them.

A length d = |x_j - x_i| has the variance n^T D n, n its direction, D the covariance of
the difference: linear, so a length must be long against its uncertainty (JCGM 102,
6.2). Features: `traverse.kinematics.features`.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits.shapes import Sphere

COVERAGE_FACTOR = 2.0
_PLACES = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


def covariances_of(tensors_mm2: Floats) -> Floats:
    """Write xx, xy, xz, yy, yz, zz as matrices: (..., 6) gives (..., 3, 3)."""
    matrices: Floats = tensors_mm2[..., _PLACES]
    return matrices


@dataclass(frozen=True, slots=True)
class Length:
    """A length with its standard uncertainty.

    Attributes:
        with_arm: the uncertainty includes the parameters of the arm; otherwise it
            is too small.
    """

    length_mm: float
    std_mm: float
    with_arm: bool

    @property
    def expanded_mm(self) -> float:
        """U, k = 2."""
        return COVERAGE_FACTOR * self.std_mm


@dataclass(frozen=True, slots=True, eq=False)
class JointCovariance:
    """Points of one arm with the covariance of all their coordinates.

    Attributes:
        points_mm: (n_points, 3).
        covariances_mm2: Of each by itself, (n_points, 3, 3).
        shared_mm: Factors S of the arm's contribution, (n_points, 3, rank).
    """

    points_mm: Floats
    covariances_mm2: Floats
    shared_mm: Floats

    @property
    def with_arm(self) -> bool:
        return bool(self.shared_mm.size)

    @property
    def own_mm2(self) -> Floats:
        """Covariances of single points without the shared part, (n_points, 3, 3)."""
        return self.covariances_mm2 - self.shared_mm @ self.shared_mm.transpose(0, 2, 1)

    @property
    def covariance_mm2(self) -> Floats:
        n = len(self.points_mm)
        factor = self.shared_mm.reshape(3 * n, -1)
        joint: Floats = factor @ factor.T
        for point in range(n):
            block = slice(3 * point, 3 * point + 3)
            joint[block, block] = self.covariances_mm2[point]
        return joint

    def part(self, rows: list[int]) -> "JointCovariance":
        return JointCovariance(
            self.points_mm[rows], self.covariances_mm2[rows], self.shared_mm[rows]
        )

    def joined(self, other: "JointCovariance") -> "JointCovariance":
        return JointCovariance(
            np.concatenate([self.points_mm, other.points_mm]),
            np.concatenate([self.covariances_mm2, other.covariances_mm2]),
            np.concatenate([self.shared_mm, other.shared_mm]),
        )

    def combined(self, weights: Floats) -> tuple[Floats, Floats]:
        """Propagate the errors to figures q = sum over i of W_i x_i.

        Args:
            weights: (n_figures, n_points, 3).

        Returns:
            The covariance of the figures, (n_figures, n_figures), and its part shared
            with other points by the arm, as a factor (n_figures, rank).
        """
        shared = np.einsum("qni,nir->qr", weights, self.shared_mm)
        independent: Floats = np.einsum(
            "qni,nij,pnj->qp", weights, self.own_mm2, weights
        )
        return independent + shared @ shared.T, shared

    def length(self, first: int, second: int) -> Length:
        """Return the length between two points, by their numbers.

        Raises:
            ValueError: they are in the same place, which leaves no direction.
        """
        way_mm = self.points_mm[second] - self.points_mm[first]
        length_mm = float(np.linalg.norm(way_mm))
        if not length_mm > 0.0:
            raise ValueError("both points are in the same place; a length has two ends")
        weights = np.stack([-way_mm, way_mm])[np.newaxis] / length_mm
        (variance_mm2,), _ = self.part([first, second]).combined(weights)
        std_mm = float(np.sqrt(max(float(variance_mm2[0]), 0.0)))
        return Length(length_mm, std_mm, self.with_arm)


def fit_weights(design: Floats, normals: Floats) -> Floats:
    """Return how points move parameters q with n_i dx_i = design_i dq.

    Args:
        design: (n_points, n_parameters).
        normals: n_i of the surface, (n_points, 3).

    Returns:
        W_i for `JointCovariance.combined`, (n_parameters, n_points, 3).
    """
    weights: Floats = np.linalg.pinv(design)[:, :, np.newaxis] * normals
    return weights


def sphere_weights(points_mm: Floats, sphere: Sphere) -> Floats:
    """Return `fit_weights` of centre and radius, (4, n_points, 3)."""
    normals = points_mm - sphere.centre_mm
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    design = np.column_stack([normals, np.ones(len(normals))])
    return fit_weights(design, normals)
