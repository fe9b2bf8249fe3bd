"""The Helmert transformation: to = scale * rotation * from + translation.

A vector xi describes a small change of it about a centre c in the system that it leads
to: shift of c (mm), turn (rad), and relative change of scale, which a rigid motion has
not. A place y moves by J(y) xi, J(y) = [I, -[d]x, d] with d = y - c.

That of least squares has a closed form by a quaternion: with x and y the points about
their weighted means, the sum of w y . R x is q' N q for the unit quaternion q of R; N
is the symmetric 4 x 4 matrix of F. Sanso (1973) and B. K. P. Horn (1987), and the
largest of it belongs to the eigenvector of its largest eigenvalue. Scale and shift
follow. Exact for errors that are alike in all directions.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.quaternion import rotation_matrix

N_RIGID = 6
PARAMETERS = (
    *("shift_x_mm", "shift_y_mm", "shift_z_mm"),
    *("turn_x_rad", "turn_y_rad", "turn_z_rad"),
    "scale",
)


@dataclass(frozen=True, slots=True, eq=False)
class Helmert:
    """A rotation, a shift, a scale.

    Attributes:
        rotation: Proper, (3, 3).
        translation_mm: (3,).
        scale: Above zero.
    """

    rotation: Floats
    translation_mm: Floats
    scale: float = 1.0

    def places_mm(self, from_mm: Floats) -> Floats:
        """Transform places (n, 3)."""
        turned: Floats = from_mm @ self.rotation.T
        return self.scale * turned + self.translation_mm

    def after(self, first: Self) -> "Helmert":
        """Compose with a transformation that is applied before."""
        return Helmert(
            self.rotation @ first.rotation,
            self.places_mm(first.translation_mm[np.newaxis])[0],
            self.scale * first.scale,
        )

    def inverse(self) -> "Helmert":
        back = self.rotation.T
        return Helmert(back, -(back @ self.translation_mm) / self.scale, 1 / self.scale)


def cross_matrices(vectors: Floats) -> Floats:
    """Write v x as matrices: (n, 3) gives (n, 3, 3)."""
    x, y, z = vectors.T
    none = np.zeros(len(vectors))
    rows = [[none, -z, y], [z, none, -x], [-y, x, none]]
    return np.moveaxis(np.array(rows), 2, 0)


def skew_vector(matrix: Floats) -> Floats:
    """Take the vector (3,) of M - M', for M (3, 3)."""
    m = matrix
    return np.array([m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0]])


def motions(from_centre_mm: Floats, n_parameters: int) -> Floats:
    """Compute J, how places move with xi.

    Args:
        from_centre_mm: d, (n, 3).
        n_parameters: 6, or 7 with a scale.

    Returns:
        (n, 3, n_parameters).
    """
    n = len(from_centre_mm)
    parts = [np.tile(np.eye(3), (n, 1, 1)), -cross_matrices(from_centre_mm)]
    if n_parameters > N_RIGID:
        parts.append(from_centre_mm[:, :, np.newaxis])
    return np.concatenate(parts, axis=2)


def moved_centre(
    covariance: Floats, centre_mm: Floats, new_centre_mm: Floats
) -> Floats:
    """Transform the covariance of xi to another centre.

    Args:
        covariance: about the old one, (n_parameters, n_parameters).
        centre_mm: the old one, (3,).
        new_centre_mm: (3,).
    """
    n_parameters = len(covariance)
    change = np.eye(n_parameters)
    away = (new_centre_mm - centre_mm)[np.newaxis]
    change[:3] = motions(away, n_parameters)[0]
    moved: Floats = change @ covariance @ change.T
    return moved


def closed_helmert(
    from_mm: Floats, to_mm: Floats, weights: Floats, *, with_scale: bool
) -> Helmert:
    """Solve for rotation, shift and, if requested, scale.

    The points have to determine it: see `traverse.kinematics.helmert.shape`.

    Args:
        from_mm: (n, 3).
        to_mm: The same points in the other system, (n, 3).
        weights: Above zero, (n,).
        with_scale: Else it is 1. The scale is symmetric in both systems: the ratio of
            the extents.
    """
    shares = weights / weights.sum()
    from_mean_mm, to_mean_mm = shares @ from_mm, shares @ to_mm
    x, y = from_mm - from_mean_mm, to_mm - to_mean_mm
    rotation = rotation_matrix(_best_quaternion((shares[:, np.newaxis] * x).T @ y))
    scale = 1.0
    if with_scale:
        extents = [float(shares @ np.sum(part**2, axis=1)) for part in (x, y)]
        scale = float(np.sqrt(extents[1] / extents[0]))
    return Helmert(rotation, to_mean_mm - scale * (rotation @ from_mean_mm), scale)


def quaternion_of(rotation: Floats) -> Floats:
    """Turn a rotation matrix into a unit quaternion, by its largest component."""
    m = rotation
    squares = np.array(
        [
            1.0 + m[0, 0] + m[1, 1] + m[2, 2],
            1.0 + m[0, 0] - m[1, 1] - m[2, 2],
            1.0 - m[0, 0] + m[1, 1] - m[2, 2],
            1.0 - m[0, 0] - m[1, 1] + m[2, 2],
        ]
    )
    products = np.array(
        [
            [squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], squares[1], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], squares[2], m[2, 1] + m[1, 2]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], squares[3]],
        ]
    )
    row: Floats = products[np.argmax(squares)]
    return row / np.linalg.norm(row)


def _best_quaternion(moments: Floats) -> Floats:
    """Maximise q' N q.

    Args:
        moments: S = sum of w x y', (3, 3).
    """
    normal = np.empty((4, 4))
    # The vector of S - S', whose cross matrix is S' - S.
    skew = skew_vector(moments)
    trace = float(np.trace(moments))
    normal[0, 0] = trace
    normal[0, 1:] = normal[1:, 0] = skew
    normal[1:, 1:] = moments + moments.T - trace * np.eye(3)
    _, vectors = np.linalg.eigh(normal)
    best: Floats = vectors[:, -1]
    return best


def mirrored_share(from_mm: Floats, to_mm: Floats) -> float:
    """Compare the fit with the mirror image's.

    Returns:
        Sum of squares of the best mirrored fit over that of the best proper one: far
        below 1 where a system is left-handed or names are exchanged; 1 for points in
        one plane, which are their own mirror image. Both in units of their own extent.
    """
    x, y = from_mm - from_mm.mean(axis=0), to_mm - to_mm.mean(axis=0)
    x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
    left, sizes, right = np.linalg.svd(x.T @ y)
    proper = 1.0 if np.linalg.det(left @ right) > 0.0 else -1.0
    best, mirrored = (
        2.0 - 2.0 * float(sizes[0] + sizes[1] + sign * sizes[2])
        for sign in (proper, -proper)
    )
    rounding = 1e-14
    return (max(mirrored, 0.0) + rounding) / (max(best, 0.0) + rounding)
