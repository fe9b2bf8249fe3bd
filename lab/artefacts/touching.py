"""Postures in which the ball touches an artefact."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.artefacts.artefact import Artefact, Equations, Touches

_STEPS = 15
_LARGEST_STEP_RAD = 0.5
# A hundredth of the reach keeps steps bounded where the arm is stretched.
_STIFFNESS_MM2 = 100.0
_REACHED_MM = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class TouchingPostures:
    """Where the joints were.

    Attributes:
        angles_rad: (n, n_joints).
        is_touching: Whether the ball touches, within the joints' limits, (n,).
    """

    angles_rad: Floats
    equations: Equations
    is_touching: Booleans


def postures_touching(
    artefact: Artefact,
    unknowns: Floats,
    touches: Touches,
    geometry: Geometry,
    tries_rad: Floats,
    *,
    limits_rad: Floats,
) -> TouchingPostures:
    """Turn the joints until the ball touches the artefact, as far as possible.

    From tries, (n, n_joints), one for each of n touches. Limits are the smallest and
    the largest readings, (2, n_joints).
    """
    angles_rad = tries_rad
    for _ in range(_STEPS):
        derivatives = probe_derivatives(geometry, angles_rad)
        equations = artefact.equations(unknowns, derivatives.centres_mm, touches)
        slopes = equations.by_centre @ derivatives.by_angles
        square = slopes @ slopes.swapaxes(1, 2)
        square = square + _STIFFNESS_MM2 * np.eye(square.shape[1])
        solved = np.linalg.solve(square, equations.misclosures_mm[:, :, np.newaxis])
        step = -(slopes.swapaxes(1, 2) @ solved)[:, :, 0]
        angles_rad = angles_rad + np.clip(step, -_LARGEST_STEP_RAD, _LARGEST_STEP_RAD)
    centres_mm = probe_centre(geometry, angles_rad)
    equations = artefact.equations(unknowns, centres_mm, touches)
    misses_mm = np.max(np.abs(equations.misclosures_mm), axis=1)
    least_rad, largest_rad = limits_rad
    within = np.all((angles_rad >= least_rad) & (angles_rad <= largest_rad), axis=1)
    return TouchingPostures(angles_rad, equations, within & (misses_mm < _REACHED_MM))
