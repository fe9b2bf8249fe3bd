"""Questions about values that are implausible in their unit."""

import math
from collections.abc import Iterator

from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.model.geometry import Geometry, geometry_from_arm
from traverse.kinematics.model.origins import length_mm, near_origins

# No arm is larger (the longest in use is that of a space station, 18 m), or smaller.
_LONGEST_MM = 20_000.0
_SHORTEST_MM = 10.0
_FULL_TURN_RAD = 2.0 * math.pi * (1.0 + 1e-3)
_EIGHTHS = 8  # of a turn
_EIGHTH_RAD = 2.0 * math.pi / _EIGHTHS
_PRINTED_RAD = 5e-4  # by as much as three decimals round


def angle_doubt(name: str, angle_rad: float) -> Iterator[str]:
    """Ask whether an angle of more than a turn was given in degrees."""
    if abs(angle_rad) > _FULL_TURN_RAD:
        yield (
            f"{name} is {angle_rad:g}, more than a turn in radians: degrees? "
            f"{angle_rad:g} degrees are {math.radians(angle_rad):.10g}"
        )


def degrees_doubt(what: str, angle_rad: float) -> Iterator[str]:
    """Ask whether an angle that was given in degrees was meant in radians.

    Nobody sets 1.5708 degrees, and many a table has pi/2.
    """
    degrees = math.degrees(angle_rad)
    eighths = round(degrees / _EIGHTH_RAD)
    is_part_of_pi = abs(degrees - eighths * _EIGHTH_RAD) < _PRINTED_RAD
    if 0 < abs(eighths) <= _EIGHTHS and is_part_of_pi:
        yield (
            f"{what} is {degrees:.10g} degrees, a part of pi: radians? "
            f"{degrees:.6g} rad are {math.degrees(degrees):.4g} degrees"
        )


def reach_doubt(geometry: Geometry) -> Iterator[str]:
    """Ask whether lengths were given in another unit."""
    reach_mm = length_mm(near_origins(geometry))
    if reach_mm > _LONGEST_MM:
        yield f"reach {1e-3 * reach_mm:.4g} m: were millimetres taken for metres?"
    elif 0.0 < reach_mm < _SHORTEST_MM:
        yield f"reach {reach_mm:.3g} mm: were metres taken for millimetres?"


def arm_doubts(arm: Arm) -> Iterator[str]:
    for joint in arm.joints:
        yield from angle_doubt(f"zero_rad of {joint.name}", joint.zero_rad)
    yield from reach_doubt(geometry_from_arm(arm))
