"""A stylus that bends under the contact force.

The surface pushes the ball with force_n against the direction towards the material;
the ball yields along the part of that force that is across the shank:

    shift = -compliance_mm_n force_n (d - s (s . d))

with d the direction towards the material and s the shank. An unknown force is 1 N.
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.arrays import Floats
from traverse.kinematics.effects.base.bodies import dot
from traverse.kinematics.effects.base.contact import Contact
from traverse.kinematics.effects.contacts.touching import Touching


@dataclass(frozen=True, slots=True, kw_only=True)
class StylusBending(Touching):
    """The ball is pushed away from the material."""

    kind: ClassVar[str] = "stylus_bending"

    def derivatives(self, contact: Contact) -> Floats:
        """The force across the shank in N, (1, 3, n_samples)."""
        directions, shanks = contact.directions, contact.shanks
        across = directions - shanks * dot(shanks, directions)
        return (-contact.force_n * across)[None]
