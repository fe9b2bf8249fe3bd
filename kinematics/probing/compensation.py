"""From the ball's centre to the touched point: the direction of the material.

surface = centre + radius n, n the unit vector from the ball to the material

Ways to know n: the shank points at the material (`shank`); the probe approached from a
place in the air (`pretouch`) or was pulled off to one (`pulled`), opposite to the
material; the part is touched from outside or from inside, as seen from a point in its
middle (`outside`, `inside`).
"""

from collections.abc import Callable

import numpy as np

from traverse.arrays import Floats

_SHORTEST_MM = 0.1  # below, noise and tremble would choose the direction


class DirectionError(ValueError):
    """The direction of the material is unknown; states the reason and the remedy."""


def towards_material(
    method: str, centre_mm: Floats, shank: Floats, other_mm: Floats | None
) -> Floats:
    """Return the direction from the ball to the material.

    Args:
        method: one of `METHODS`.
        centre_mm: of the ball at the touch, (3,).
        shank: unit vector from wrist to ball, (3,).
        other_mm: the place before or after the touch, or the middle of the part,
            (3,); None if the method needs none.

    Returns:
        Unit vector, (3,).

    Raises:
        DirectionError: the other place is not known, or too near.
    """
    if method == "shank":
        return shank
    if other_mm is None:
        raise DirectionError(f"{method}: {_WANTED[method]}")
    away_mm = _AWAY[method](centre_mm, other_mm)
    length_mm = float(np.linalg.norm(away_mm))
    if not length_mm >= _SHORTEST_MM:
        raise DirectionError(
            f"{method}: the two places are {length_mm:.3g} mm apart, expected at least "
            f"{_SHORTEST_MM:g} mm; {_WANTED[method]}"
        )
    direction: Floats = away_mm / length_mm
    return direction


def surface_point(centre_mm: Floats, direction: Floats, radius_mm: float) -> Floats:
    """Compute the touched point, (3,).

    Args:
        centre_mm: Of the ball, (3,).
        direction: Unit vector towards the material, (3,).
        radius_mm: Of the ball.
    """
    return centre_mm + radius_mm * direction


_AWAY: dict[str, Callable[[Floats, Floats], Floats]] = {
    "pretouch": lambda centre_mm, before_mm: centre_mm - before_mm,
    "pulled": lambda centre_mm, after_mm: centre_mm - after_mm,
    "outside": lambda centre_mm, middle_mm: middle_mm - centre_mm,
    "inside": lambda centre_mm, middle_mm: centre_mm - middle_mm,
}

METHODS = ("shank", *_AWAY)
"""Methods, as in a point's `compensation`."""

_WANTED = {
    "pretouch": "take a point in the air before the touch, off the surface",
    "pulled": "after the touch pull the probe off the surface before letting go",
    "outside": "name a point in the middle of the part",
    "inside": "name a point in the middle of the hole",
}
