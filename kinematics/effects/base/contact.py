"""Contact of the ball: direction and force in the probe's system.

The azimuth psi of a direction about the shank counts, right-handed about the shank,
from v = normalise(e - (e . s) s), e the unit vector of the smallest component of the
shank s, both in the base posture and carried along by P_n.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.model.geometry import Geometry, across
from traverse.kinematics.model.quaternion import dot, rotate


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """The touched surface, zero where it is unknown, so that nothing is corrected.

    Attributes:
        directions: Unit vectors from the ball towards the material, (3, n_samples).
        shanks: Unit vectors along the shank towards the ball, (3, n_samples).
        triple_cosine: cos 3 psi; 1 for a direction along the shank, (n_samples,).
        triple_sine: sin 3 psi, (n_samples,).
        force_n: 1 where it is unknown, (n_samples,).
    """

    directions: Floats
    shanks: Floats
    triple_cosine: Floats
    triple_sine: Floats
    force_n: Floats


def contact_seen(geometry: Geometry, block: Block, rotations: Floats) -> Contact:
    """Return the block's contacts in the probe's system.

    Args:
        geometry: the arm.
        block: with or without directions and forces.
        rotations: of the last element, (4, n_samples).
    """
    shanks = rotate(rotations, geometry.probe_direction[:, np.newaxis])
    directions = _directions(block)
    first, second = across(geometry.probe_direction)
    cosine = dot(directions, rotate(rotations, first[:, np.newaxis]))
    sine = dot(directions, rotate(rotations, second[:, np.newaxis]))
    across_shank = np.sqrt(cosine * cosine + sine * sine)
    is_aside = across_shank > 0.0
    scale = np.where(is_aside, across_shank, 1.0)
    cosine = np.where(is_aside, cosine / scale, 1.0)
    sine = sine / scale
    if block.force_n is None:
        force_n = np.ones(len(block))
    else:
        force_n = np.where(np.isnan(block.force_n), 1.0, block.force_n)
    return Contact(
        directions=directions,
        shanks=shanks,
        triple_cosine=cosine * (4.0 * cosine * cosine - 3.0),
        triple_sine=sine * (3.0 - 4.0 * sine * sine),
        force_n=force_n,
    )


def _directions(block: Block) -> Floats:
    if block.directions is None:
        return np.zeros((3, len(block)))
    directions = np.ascontiguousarray(block.directions.T)
    lengths = np.sqrt(dot(directions, directions))
    is_known = lengths > 0.0  # not where NaN either
    return np.where(is_known, directions / np.where(is_known, lengths, 1.0), 0.0)
