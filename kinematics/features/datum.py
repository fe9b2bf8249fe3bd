"""3-2-1 from features: a plane, a line and a point make the part's system.

The plane's normal is z, the line along it is x; z = 0 in the plane, y = 0 on the line,
x = 0 at the point.
"""

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.features.relations import SHAPES
from traverse.kinematics.fits.elements import Element
from traverse.kinematics.helmert.transformation import Helmert

_LEAST_SINE = 0.1  # 6 degrees between the line and the plane's normal


def datum_system(
    plane: Element, line: Element, point: Element, forwards: Floats
) -> Helmert:
    """Return the transformation into the part's system.

    Args:
        plane: primary.
        line: an edge or axis, secondary.
        point: a point, or a centre, tertiary.
        forwards: about the sense of the line, (3,).

    Raises:
        ValueError: they are of other kinds, or the line stands on the plane.
    """
    shapes = tuple(SHAPES[element.kind] for element in (plane, line, point))
    if shapes != ("plane", "line", "point"):
        raise ValueError(
            "3-2-1 needs a plane, a line or axis, and a point or centre, not "
            + ", ".join(shapes)
        )
    normal = plane.direction
    along = line.direction - normal * float(normal @ line.direction)
    sine = float(np.linalg.norm(along))
    if sine < _LEAST_SINE:
        raise ValueError("the line stands on the plane; take one along it")
    first = along / sine * (1.0 if along @ forwards >= 0.0 else -1.0)
    rotation = np.stack([first, np.cross(normal, first), normal])
    levels = [element.place_mm for element in (point, line, plane)]
    origin = np.array([axis @ mm for axis, mm in zip(rotation, levels, strict=True)])
    return Helmert(rotation, -origin)
