"""Rotations of all joints in few calls of NumPy, bit for bit as in `quaternion`.

A daemon corrects blocks of some dozens of samples, where most of the time is spent in
calling NumPy and not into its arithmetic. Here components are multiplied together
instead of one by one; every number is added up in the same order, so every bit is
that of `quaternion.multiply` and `quaternion.rotate`.
"""

import numpy as np

from traverse.arrays import Floats

# p q = sum over i of p_i times these components of q with these signs.
_COMPONENTS = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
_SIGNS = np.array(
    [
        [1.0, 1.0, 1.0, 1.0],
        [-1.0, 1.0, -1.0, 1.0],
        [-1.0, 1.0, 1.0, -1.0],
        [-1.0, -1.0, 1.0, 1.0],
    ]
)[:, :, np.newaxis, np.newaxis]


def chain_rotations(turns: Floats) -> Floats:
    """Multiply from the base outwards.

    Args:
        turns: Quaternions of the joints, (4, n_joints, n_samples).

    Returns:
        Of the bodies, (4, n_joints, n_samples).
    """
    factors = _factors(turns)
    rotations = np.empty_like(turns)
    rotations[:, 0] = turns[:, 0]
    for k in range(1, turns.shape[1]):
        before = rotations[:, np.newaxis, k - 1]
        np.add.reduce(before * factors[:, :, k], axis=0, out=rotations[:, k])
    return rotations


def composed(first: Floats, then: Floats) -> Floats:
    """Compose rotations of the joints: p q, first the rotation q, then p.

    Args:
        first: q, (4, n_joints, n_samples).
        then: p, likewise.

    Returns:
        (4, n_joints, n_samples).
    """
    product: Floats = np.add.reduce(then[:, np.newaxis] * _factors(first), axis=0)
    return product


def rotated(rotations: Floats, vectors: Floats) -> Floats:
    """Rotate vectors: v + w t + q x t with t = 2 q x v.

    Args:
        rotations: (4, ...).
        vectors: (3, ...), broadcast against the rest of the rotations' shape.

    Returns:
        (3, ...).
    """
    axes = _cyclic(rotations[1:])
    twice = _cross(axes, _cyclic(vectors))
    twice *= 2.0
    moved: Floats = rotations[0] * twice
    moved += vectors
    moved += _cross(axes, _cyclic(twice))
    return moved


def conjugate(rotations: Floats) -> Floats:
    """The rotations backwards, (4, ...)."""
    backwards: Floats = -rotations
    backwards[0] = rotations[0]
    return backwards


def _factors(turns: Floats) -> Floats:
    """What each component of the left factor is multiplied by, (4, 4, ...)."""
    factors: Floats = turns[_COMPONENTS]
    factors *= _SIGNS
    return factors


def _cyclic(vectors: Floats) -> Floats:
    """Repeat x and y after z, so that neighbours are views: (3, ...) -> (5, ...)."""
    return np.concatenate((vectors, vectors[:2]))


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross product of vectors as returned by `_cyclic`, (3, ...)."""
    product = a[1:4] * b[2:5]
    product -= a[2:5] * b[1:4]
    return product
