"""Check that touches are spread as a standard requires; gives remarks only."""

from collections.abc import Iterator, Sequence

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.geometry import across
from traverse.lab.measured_points.measurement import ArtefactTouches, Measurement

_LEAST_FROM_POLE = 75.0  # degrees; the pattern extends to 90
_LARGEST_HOLE = 50.0  # degrees from a direction of the pattern to the nearest touch
_LEAST_SPREAD = 0.10  # least mean square of cosines; 1/3 where directions are even
# So many points at such an angle from the pole, in degrees.
_RINGS = ((1, 0.0), (4, 22.5), (8, 45.0), (4, 67.5), (8, 90.0))


def pattern_25(pole: Floats) -> Floats:
    """Return the 25 directions of a test sphere about a unit pole, (25, 3)."""
    frame = np.vstack([*across(pole), pole])
    directions = []
    for index, (number, angle_deg) in enumerate(_RINGS):
        # Every other ring is turned by half a step.
        turns = 2.0 * np.pi * (np.arange(number) + 0.5 * (index % 2)) / number
        off = np.radians(angle_deg)
        aside = np.sin(off) * np.column_stack([np.cos(turns), np.sin(turns)])
        directions.append(np.column_stack([aside, np.full(number, np.cos(off))]))
    pattern: Floats = np.concatenate(directions) @ frame
    return pattern


def half_sphere_remarks(
    touched: ArtefactTouches, centre_mm: Floats, name: str
) -> Iterator[str]:
    """Return where 25 points do not cover the half sphere about their pole."""
    outwards = touched.places_mm - centre_mm
    outwards = outwards / np.linalg.norm(outwards, axis=1, keepdims=True)
    pole = outwards.mean(axis=0)
    if not np.linalg.norm(pole) > 0.1:
        return  # all around, more than required
    pole = pole / np.linalg.norm(pole)
    farthest = float(np.degrees(np.arccos(np.clip(outwards @ pole, -1.0, 1.0)).max()))
    if farthest < _LEAST_FROM_POLE:
        yield (
            f"{name}: points go to {farthest:.0f} degrees from their middle, expected "
            "about 90"
        )
        return
    nearest = np.max(pattern_25(pole) @ outwards.T, axis=1)
    hole = float(np.degrees(np.arccos(np.clip(nearest.min(), -1.0, 1.0))))
    if hole > _LARGEST_HOLE:
        yield (
            f"{name}: a part of the half sphere has no point within {hole:.0f} degrees"
        )


def direction_remarks(measured: Measurement, names: Sequence[str]) -> Iterator[str]:
    """Report lengths that all lie in one plane or along one line."""
    ways = []
    for name in names:
        touched = measured.of(name)
        ends = list(dict.fromkeys(touched.features))
        if len(ends) == 2:
            first, second = (touched.of(end).places_mm.mean(axis=0) for end in ends)
            ways.append((second - first) / np.linalg.norm(second - first))
    if len(ways) < 3:
        return
    cosines = np.array(ways)
    sizes, directions = np.linalg.eigh(cosines.T @ cosines / len(cosines))
    if sizes[0] < _LEAST_SPREAD:
        x, y, z = directions[:, 0]
        yield (
            f"lengths hardly go along ({x:.2f}, {y:.2f}, {z:.2f}): root mean square "
            f"cosine {np.sqrt(sizes[0]):.2f}, 0.58 where directions are even"
        )
