"""Places in two systems, and what their alignment says."""

import numpy as np
from scipy.spatial.transform import Rotation

from traverse.kinematics.helmert.transformation import Helmert
from traverse.kinematics.helmert.volume import Box
from traverse.lab.alignment.best_fit import best_fit_alignment
from traverse.lab.alignment.files import alignment_values
from traverse.lab.alignment.nominal import fixed_volume
from traverse.lab.alignment.touches import CommonPoints, Place

BOX = Box(np.zeros(3), np.array([1000.0, 600, 400]))
WIDE = np.array([[0.0, 0, 0], [1000, 0, 100], [1000, 600, 0], [0, 600, 300]])
STD_MM = 0.03


def transformation(seed=1):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    return Helmert(turn, rng.uniform(-500, 500, 3))


def common(to_mm, seed=None, std_mm=STD_MM, stated=True):
    rng = np.random.default_rng(seed)
    from_mm = transformation().inverse().places_mm(to_mm)
    if seed is not None:
        from_mm = from_mm + rng.normal(0.0, std_mm, from_mm.shape)
    covariance = std_mm**2 * np.eye(3) if stated else None
    return CommonPoints(
        tuple(f"P{row}" for row in range(len(to_mm))),
        tuple(Place(place, covariance) for place in from_mm),
        tuple(Place(place, None) for place in to_mm),
    )


def fitted(to_mm, seed=None, **options):
    return best_fit_alignment(
        common(to_mm, seed, **options), fixed_volume(BOX), "of the test"
    )


def codes(alignment):
    return {flag.code for flag in alignment.flags}


def values_of(alignment, name="part"):
    return alignment_values(alignment, name=name, arm=None, measured="m", nominal="n")
