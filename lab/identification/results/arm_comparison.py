"""Two arms compared at the probe: where they differ, not by which parameters.

Both get the same readings; the best-fit motion of one arm as a whole is taken out,
because it depends on the datum only. What is left is how differently they measure.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.helmert.transformation import closed_helmert, skew_vector
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.report.quantities import picked

_SEED = 20_171_101
_N_POSTURES = 5000
# Zones of reach, as in the articulation test: near, middle, far.
_ZONES = {"near": (0.0, 0.2), "middle": (0.2, 0.8), "far": (0.8, np.inf)}


class ComparisonError(ValueError):
    """The same readings do not apply to both arms."""


@dataclass(frozen=True, slots=True)
class ZoneDifference:
    """Differences in a zone of reach.

    Attributes:
        name: near (to 20 % of the reach from the first joint), middle, far (from 80 %).
        rms_mm: Root mean square of the distances; NaN without postures.
    """

    name: str
    n_postures: int
    rms_mm: float
    largest_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """How two arms differ at the probe.

    Attributes:
        rms_mm: Root mean square of the distances between the two balls.
        largest_at_rad: The readings there, (n_joints,).
        largest_at_mm: The ball of the first arm there, (3,).
        shift_rms_mm: Root mean square of the distances before the motion of the whole
            arm was taken out.
        turn_rad: Angle of that motion.
    """

    n_postures: int
    rms_mm: float
    median_mm: float
    largest_mm: float
    largest_at_rad: Floats
    largest_at_mm: Floats
    shift_rms_mm: float
    turn_rad: float
    zones: tuple[ZoneDifference, ...]


def compare_arms(
    first: Arm,
    second: Arm,
    ranges_rad: tuple[Floats, Floats] | None = None,
    n_postures: int = _N_POSTURES,
) -> Comparison:
    """Compare two arms over random postures, at least four; the first gives places.

    They lie between the smallest and largest readings, (n_joints,) each; default a
    whole turn about the first arm's base posture.

    Raises:
        ComparisonError: The joints differ.
    """
    names = tuple(joint.name for joint in first.joints)
    theirs = tuple(joint.name for joint in second.joints)
    if names != theirs:
        raise ComparisonError(
            f"arm '{first.name}' has the joints {', '.join(names)}, arm "
            f"'{second.name}' {', '.join(theirs)}; compare arms of the same joints"
        )
    geometry = geometry_from_arm(first)
    if ranges_rad is None:
        ranges_rad = (geometry.zeros_rad - np.pi, geometry.zeros_rad + np.pi)
    rng = np.random.default_rng(_SEED)
    angles_rad = rng.uniform(*ranges_rad, (n_postures, len(names)))
    first_mm = probe_centre(geometry, angles_rad)
    second_mm = probe_centre(geometry_from_arm(second), angles_rad)
    motion = closed_helmert(second_mm, first_mm, np.ones(n_postures), with_scale=False)
    apart_mm = np.linalg.norm(motion.places_mm(second_mm) - first_mm, axis=1)
    # From the antisymmetric part: the cosine says nothing about small angles.
    sine = np.linalg.norm(skew_vector(motion.rotation))
    turn_rad = float(np.arctan2(sine, np.trace(motion.rotation) - 1.0))
    worst = int(np.argmax(apart_mm))
    from_base_mm = np.linalg.norm(first_mm - geometry.origin_mm, axis=1)
    return Comparison(
        n_postures=n_postures,
        rms_mm=_rms(apart_mm),
        median_mm=float(np.median(apart_mm)),
        largest_mm=float(apart_mm[worst]),
        largest_at_rad=angles_rad[worst],
        largest_at_mm=first_mm[worst],
        shift_rms_mm=_rms(np.linalg.norm(second_mm - first_mm, axis=1)),
        turn_rad=turn_rad,
        zones=_zones(from_base_mm / from_base_mm.max(), apart_mm),
    )


def _zones(parts: Floats, apart_mm: Floats) -> tuple[ZoneDifference, ...]:
    zones = []
    for name, (least, most) in _ZONES.items():
        mine = apart_mm[(parts >= least) & (parts < most)]
        figures = (_rms(mine), float(mine.max())) if len(mine) else (np.nan, np.nan)
        zones.append(ZoneDifference(name, len(mine), *figures))
    return tuple(zones)


def _rms(lengths_mm: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(lengths_mm))))


def comparison_values(
    files: Sequence[Path], arms: Sequence[Arm], comparison: Comparison
) -> dict[str, Any]:
    names = [joint.name for joint in arms[0].joints]
    return {
        "arms": [_provenance(file, arm) for file, arm in zip(files, arms, strict=True)],
        **picked(comparison, "n_postures", "rms_mm", "median_mm", "largest_mm"),
        "largest_at_mm": comparison.largest_at_mm.tolist(),
        "largest_at_rad": dict(
            zip(names, comparison.largest_at_rad.tolist(), strict=True)
        ),
        "taken_out": picked(comparison, "turn_rad", rms_mm="shift_rms_mm"),
        "zones": {
            zone.name: picked(zone, "n_postures", "rms_mm", "largest_mm")
            for zone in comparison.zones
        },
    }


def _provenance(file: Path, arm: Arm) -> dict[str, Any]:
    made = arm.identification
    return {
        "file": str(file),
        "name": arm.name,
        "date": None if made is None or made.date is None else str(made.date),
        "sigma0": None if made is None else made.sigma0,
        "redundancy": None if made is None else made.redundancy,
        "effects": len(arm.effects),
    }
