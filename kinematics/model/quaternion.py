"""Unit quaternions as rotations, many at once.

Scalar first, component first: an array (4, ...) holds w, x, y, z as contiguous rows,
and vectors likewise are (3, ...). Everything is elementwise, without matrix products,
so that a sample's result does not depend on the samples beside it, bit for bit.
"""

import numpy as np

from traverse.arrays import Floats


def turn(axis: Floats, angles_rad: Floats) -> Floats:
    """Make the quaternions R(axis, angle) = (cos angle/2, sin angle/2 axis).

    Args:
        axis: Unit vectors, (3, ...), broadcast against the angles.
        angles_rad: (...).

    Returns:
        (4, ...).
    """
    half = 0.5 * angles_rad
    sine = np.sin(half)
    return np.stack([np.cos(half), sine * axis[0], sine * axis[1], sine * axis[2]])


def multiply(p: Floats, q: Floats) -> Floats:
    """Compose p q: first the rotation q, then p.

    Args:
        p: (4, ...).
        q: (4, ...).

    Returns:
        (4, ...).
    """
    pw, px, py, pz = p
    qw, qx, qy, qz = q
    return np.stack(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ]
    )


def rotate(q: Floats, vectors: Floats) -> Floats:
    """Rotate vectors: v + w t + q x t with t = 2 q x v.

    Args:
        q: (4, ...).
        vectors: (3, ...), broadcast against the rest of q's shape.

    Returns:
        (3, ...).
    """
    w, x, y, z = q
    vx, vy, vz = vectors
    tx = 2.0 * (y * vz - z * vy)
    ty = 2.0 * (z * vx - x * vz)
    tz = 2.0 * (x * vy - y * vx)
    return np.stack(
        [
            vx + w * tx + (y * tz - z * ty),
            vy + w * ty + (z * tx - x * tz),
            vz + w * tz + (x * ty - y * tx),
        ]
    )


def small_turn(vectors_rad: Floats) -> Floats:
    """Make the quaternions of rotation vectors, exactly: (3, ...) -> (4, ...)."""
    x, y, z = vectors_rad
    lengths = np.sqrt(x * x + y * y + z * z)
    is_turn = lengths > 0.0
    scale = np.where(is_turn, np.sin(0.5 * lengths) / np.where(is_turn, lengths, 1), 0)
    return np.stack([np.cos(0.5 * lengths), scale * x, scale * y, scale * z])


def rotation_matrix(q: Floats) -> Floats:
    """Write a rotation, (4,), as a matrix (3, 3)."""
    return rotate(q[:, np.newaxis], np.eye(3))


def rotation_vectors(q: Floats) -> Floats:
    """Return axis times angle in rad, at most pi: (4, ...) -> (3, ...)."""
    sine = np.linalg.norm(q[1:], axis=0)
    angle = 2.0 * np.arctan2(sine, np.abs(q[0]))
    factor = np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 0.0)
    vectors: Floats = np.where(q[0] < 0.0, -factor, factor) * q[1:]
    return vectors


def conjugate(q: Floats) -> Floats:
    """Return the inverse rotations, (4, ...)."""
    backwards: Floats = -q
    backwards[0] = q[0]
    return backwards


def chain_rotations(turns: Floats) -> Floats:
    """Multiply from the base outwards: turns of joints to rotations of bodies.

    Both are (4, n_joints, n_samples).
    """
    rotations = np.empty_like(turns)
    rotations[:, 0] = turns[:, 0]
    for k in range(1, turns.shape[1]):
        rotations[:, k] = multiply(rotations[:, k - 1], turns[:, k])
    return rotations


def cross(a: Floats, b: Floats) -> Floats:
    """Cross product of vectors (3, ...), component by component."""
    ax, ay, az = a
    bx, by, bz = b
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def dot(a: Floats, b: Floats) -> Floats:
    """Scalar product of vectors (3, ...), always added in the same order."""
    product: Floats = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product
