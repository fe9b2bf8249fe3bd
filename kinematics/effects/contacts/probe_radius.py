"""A ball that is larger or smaller than it is said to be.

    effective radius = radius_mm + radius_error_mm

The material begins one effective radius from the ball's centre. The corrected centre
is the one from which it begins at radius_mm: the centre moves towards the material by
radius_error_mm.
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.arrays import Floats
from traverse.kinematics.effects.base.contact import Contact
from traverse.kinematics.effects.contacts.touching import Touching


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbeRadius(Touching):
    """The same in all directions."""

    kind: ClassVar[str] = "probe_radius"

    def derivatives(self, contact: Contact) -> Floats:
        """Towards the material, (1, 3, n_samples)."""
        return contact.directions[None]
