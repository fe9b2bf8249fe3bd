"""Whitening: L^-1 of the dispersion B Q B^T = L L^T of each pose's misclosures."""

import numpy as np

from traverse.arrays import Floats


def whiteners(by_readings: Floats, by_contact: Floats) -> Floats:
    """Compute L^-1 of many small dispersions, in closed form.

    Args:
        by_readings: Derivatives by readings times their standard deviations,
            (n_poses, n_rows, n_joints), with n_rows 1 or 3.
        by_contact: The same by the contact's components, (n_poses, n_rows, 3).

    Returns:
        Lower triangles, (n_poses, n_rows, n_rows).
    """
    noise = np.concatenate([by_readings, by_contact], axis=2)
    if noise.shape[1] == 1:
        variances = np.einsum("nij,nij->ni", noise, noise)
        factors: Floats = 1.0 / np.sqrt(variances)[:, :, np.newaxis]
        return factors
    dispersion = noise @ noise.swapaxes(1, 2)
    return _inverse_factors(dispersion)


def _inverse_factors(matrices: Floats) -> Floats:
    """Invert the Cholesky factors of 3 x 3 matrices, (n, 3, 3)."""
    a = np.sqrt(matrices[:, 0, 0])
    b = matrices[:, 1, 0] / a
    c = matrices[:, 2, 0] / a
    d = np.sqrt(matrices[:, 1, 1] - b * b)
    e = (matrices[:, 2, 1] - b * c) / d
    f = np.sqrt(matrices[:, 2, 2] - c * c - e * e)
    inverse = np.zeros_like(matrices)
    inverse[:, 0, 0] = 1.0 / a
    inverse[:, 1, 1] = 1.0 / d
    inverse[:, 2, 2] = 1.0 / f
    inverse[:, 1, 0] = -b / (a * d)
    inverse[:, 2, 1] = -e / (d * f)
    inverse[:, 2, 0] = (b * e - c * d) / (a * d * f)
    return inverse
