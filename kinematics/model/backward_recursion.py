"""Turning vectors about the joints from the tip inwards, by NumPy and in place.

With t = tan(theta / 2), of which one call of NumPy costs less than calls of sine and
cosine, and without dividing by what may vanish,

    cos theta = 2 / (1 + t^2) - 1        sin theta = 2 t / (1 + t^2)

Everything is elementwise, without matrix products, so that a sample's result does not
depend on the samples beside it, bit for bit. Arrays are used again and again: taking
new ones costs as much as the arithmetic.
"""

import numpy as np

from traverse.arrays import Floats


class JointRotations:
    """Sines and cosines of the turns of some samples.

    Args:
        angles_rad: Readings, (n_samples, n_joints).
        zeros_rad: Subtracted from them, (n_joints,).

    Attributes:
        sines: (n_joints, n_samples).
        versines: 1 - cosine, likewise.
    """

    def __init__(self, angles_rad: Floats, zeros_rad: Floats) -> None:
        # Contiguous rows: strided ones may take another path through the tangent.
        tangents = np.empty(angles_rad.shape[::-1])
        np.subtract(angles_rad.T, zeros_rad[:, np.newaxis], out=tangents)
        tangents *= 0.5
        np.tan(tangents, out=tangents)
        doubled = tangents * tangents
        doubled += 1.0
        np.divide(2.0, doubled, out=doubled)
        self.sines = tangents * doubled
        self.versines = np.subtract(2.0, doubled, out=tangents)
        doubled -= 1.0
        self.cosines = doubled


class BackwardRecursion:
    """One vector a sample, on its way from the tip to the base.

    Args:
        vector: Where all of them begin, (3,).

    Attributes:
        vectors: (3, n_samples).
    """

    def __init__(self, vector: Floats, turns: JointRotations) -> None:
        n_samples = turns.sines.shape[1]
        self._turns = turns
        # x and y once more behind z, so that neighbours in the circle are views.
        self._cyclic = np.empty((5, n_samples))
        self.vectors = self._cyclic[:3]
        self.vectors[...] = vector[:, np.newaxis]
        self._across = np.empty((3, n_samples))
        self._other = np.empty((3, n_samples))
        self._along = np.empty(n_samples)

    def turn(self, axis: Floats, joint: int) -> None:
        """Turn about an axis (3,): w cos + (u x w) sin + u (u . w) (1 - cos)."""
        vectors, across, products, along = (
            self.vectors,
            self._across,
            self._other,
            self._along,
        )
        u = np.concatenate((axis, axis[:2]))[:, np.newaxis]
        self._cyclic[3:] = vectors[:2]
        np.multiply(u[1:4], self._cyclic[2:5], out=across)
        np.multiply(u[2:5], self._cyclic[1:4], out=products)
        across -= products
        across *= self._turns.sines[joint]
        np.multiply(u[:3], vectors, out=products)
        np.add(products[0], products[1], out=along)
        along += products[2]
        along *= self._turns.versines[joint]
        vectors *= self._turns.cosines[joint]
        vectors += across
        np.multiply(u[:3], along, out=products)
        vectors += products
