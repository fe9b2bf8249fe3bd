"""The Helmert transformation of least squares in closed form, by a quaternion.

With x and y the points about their weighted means, the sum of w y . R x is q' N q for
the unit quaternion q of R; N is the symmetric 4 x 4 matrix of F. Sanso (1973) and B. K.
P. Horn (1987), and the largest of it belongs to the eigenvector of its largest
eigenvalue. Scale and shift follow. Exact for errors that are alike in all directions.
"""

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import Helmert, rotation_matrix


def closed_helmert(
    from_mm: Floats, to_mm: Floats, weights: Floats, *, with_scale: bool
) -> Helmert:
    """Solve for rotation, shift and, where wanted, scale.

    The points have to determine it: `helmert_adjustment` looks at that.

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


def _best_quaternion(moments: Floats) -> Floats:
    """Maximise q' N q.

    Args:
        moments: S = sum of w x y', (3, 3).
    """
    normal = np.empty((4, 4))
    # The vector of S - S', whose cross matrix is S' - S.
    skew = np.array(
        [
            moments[1, 2] - moments[2, 1],
            moments[2, 0] - moments[0, 2],
            moments[0, 1] - moments[1, 0],
        ]
    )
    trace = float(np.trace(moments))
    normal[0, 0] = trace
    normal[0, 1:] = normal[1:, 0] = skew
    normal[1:, 1:] = moments + moments.T - trace * np.eye(3)
    _, vectors = np.linalg.eigh(normal)
    best: Floats = vectors[:, -1]
    return best


def mirrored_share(from_mm: Floats, to_mm: Floats) -> float:
    """Compare the fit with that of the mirror image.

    Returns:
        Sum of squares of the best mirrored fit over that of the best proper one: far
        below 1 where a system is left-handed or names are exchanged; 1 for points in
        one plane, which are their own mirror image. Both in units of their own extent.
    """
    x, y = from_mm - from_mm.mean(axis=0), to_mm - to_mm.mean(axis=0)
    x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
    left, sizes, right = np.linalg.svd(x.T @ y)
    proper = 1.0 if np.linalg.det(left @ right) > 0.0 else -1.0
    best, other = (
        2.0 - 2.0 * float(sizes[0] + sizes[1] + sign * sizes[2])
        for sign in (proper, -proper)
    )
    rounding = 1e-14
    return (max(other, 0.0) + rounding) / (max(best, 0.0) + rounding)
