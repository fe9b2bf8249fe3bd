"""Covariance between points of one arm: lengths and features with their uncertainty.

Errors of an arm's parameters are the same for all its points. With S_i = A_i F of point
i (C_p = F F^T, see `arm_covariance`) and its own covariance C_i,

    cov(x_i, x_j) = S_i S_j^T,  i != j;      cov(x_i, x_i) = C_i.

Noise of encoders and contacts is each point's own. So is taken what a correction beyond
the range that the arm was seen in leaves open: between points that share such a
correction a length is stated too uncertain, or too certain where it turns by more than
a right angle between them.

A length d = |x_j - x_i| has the variance n^T D n, n its direction, D the covariance of
the difference; a feature q fitted by least squares L D_x L^T, L = dq/dx. Both are
linear: a length must be long against its uncertainty (JCGM 102, 6.2).
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits.plane import Plane, fit_plane
from traverse.kinematics.fits.sphere import Sphere, fit_sphere
from traverse.kinematics.model.geometry import across

COVERAGE_FACTOR = 2.0


@dataclass(frozen=True, slots=True)
class Length:
    """A length with its standard uncertainty.

    Attributes:
        with_arm: Whether the parameters of the arm are in the uncertainty; else it
            states less than there is.
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
        covariance_mm2: In the order x1, y1, z1, x2, ..., (3 n_points, 3 n_points).
        with_arm: Whether the parameters of the arm are in it.
    """

    points_mm: Floats
    covariance_mm2: Floats
    with_arm: bool

    def length(self, first: int, second: int) -> Length:
        """Return the length between two points, by their numbers.

        Raises:
            ValueError: They are in the same place, which leaves no direction.
        """
        way_mm = self.points_mm[second] - self.points_mm[first]
        length_mm = float(np.linalg.norm(way_mm))
        if not length_mm > 0.0:
            raise ValueError("both points are in the same place; a length has two ends")
        along = np.zeros(len(self.covariance_mm2))
        along[3 * second : 3 * second + 3] = way_mm / length_mm
        along[3 * first : 3 * first + 3] = -way_mm / length_mm
        variance_mm2 = float(along @ self.covariance_mm2 @ along)
        return Length(length_mm, float(np.sqrt(max(variance_mm2, 0.0))), self.with_arm)

    def sphere(self) -> tuple[Sphere, Floats]:
        """Fit a sphere to all points.

        Returns:
            The sphere, and the covariance of centre and radius in mm^2, (4, 4).

        Raises:
            ValueError: The points determine none.
        """
        found = fit_sphere(self.points_mm)
        normals = self.points_mm - found.centre_mm
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        design = np.column_stack([normals, np.ones(len(normals))])
        return found, self._of_fit(design, normals)

    def plane(self) -> tuple[Plane, Floats]:
        """Fit a plane to all points.

        Returns:
            The plane, and the covariance of its place along the normal in mm and of
            two small turns of the normal about axes across it in rad, (3, 3).

        Raises:
            ValueError: The points determine none.
        """
        found = fit_plane(self.points_mm)
        first, second = across(found.normal)
        local_mm = self.points_mm - found.point_mm
        design = np.column_stack(
            [np.ones(len(local_mm)), -local_mm @ first, -local_mm @ second]
        )
        normals = np.broadcast_to(found.normal, local_mm.shape)
        return found, self._of_fit(design, normals)

    def _of_fit(self, design: Floats, normals: Floats) -> Floats:
        """Covariance of parameters q that follow distances n_i dx_i = design_i dq."""
        inverse = np.linalg.pinv(design)
        by_points = (inverse[:, :, np.newaxis] * normals).reshape(len(inverse), -1)
        covariance: Floats = by_points @ self.covariance_mm2 @ by_points.T
        return covariance


def joint_covariance(
    points_mm: Floats, covariances_mm2: Floats, shared_mm: Floats
) -> JointCovariance:
    """Put points of one arm together.

    Args:
        points_mm: (n_points, 3).
        covariances_mm2: Of each by itself, (n_points, 3, 3).
        shared_mm: Factors S of what the arm contributes, (n_points, 3, rank).
    """
    n = len(points_mm)
    factor = shared_mm.reshape(3 * n, -1)
    joint = factor @ factor.T
    for point in range(n):
        at = slice(3 * point, 3 * point + 3)
        joint[at, at] = covariances_mm2[point]
    return JointCovariance(points_mm, joint, bool(shared_mm.size))
