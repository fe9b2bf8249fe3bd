"""The volume that an alignment is for: said by the user, the nominal file, or points.

It is a function of the transformation: the arm's reach is known in the arm's system,
errors are told in that of the part.
"""

from collections.abc import Callable

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.helmert.transformation import Helmert
from traverse.kinematics.helmert.volume import Ball, Box, Volume
from traverse.lab.measured_points.measurement import reach_of

VolumeFunction = Callable[[Helmert], Volume]

REACH = "reach"


def volume_from_text(text: str, arm: Arm | None) -> VolumeFunction:
    """Read what was given for a volume.

    Args:
        text: "x,y,z,x,y,z", two corners of a box in the part's system; "x,y,z,r", a
            ball there; or "reach", all that the arm can reach.
        arm: Needed for its reach.

    Raises:
        ValueError: It is none of these.
    """
    if text == REACH:
        if arm is None:
            raise ValueError("reach needs the arm file: --arm FILE")
        centre_mm, radius_mm = reach_of(arm)

        def reached(transformation: Helmert) -> Volume:
            middle_mm = transformation.places_mm(centre_mm[np.newaxis])[0]
            return Ball(middle_mm, transformation.scale * radius_mm)

        return reached
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.empty(0)
    finite = bool(np.all(np.isfinite(numbers)))
    if finite and len(numbers) == 4 and numbers[3] > 0.0:
        return fixed_volume(Ball(numbers[:3], float(numbers[3])))
    if finite and len(numbers) == 6:
        box = box_around(numbers.reshape(2, 3))
        if np.any(box.high_mm > box.low_mm):
            return fixed_volume(box)
    raise ValueError(
        f"{text!r}; expected six numbers x,y,z,x,y,z for a box, four x,y,z,r for a "
        f"ball, in mm in the part's system, or {REACH}"
    )


def box_around(places_mm: Floats) -> Box:
    """Make the smallest box along the axes that holds places (n, 3)."""
    return Box(places_mm.min(axis=0), places_mm.max(axis=0))


def fixed_volume(volume: Volume) -> VolumeFunction:
    """Take a volume that is known in the part's system."""
    return lambda _: volume
