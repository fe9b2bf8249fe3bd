"""Result of `traverse identify --compare`, as plain values."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.identification.results.arm_comparison import Comparison


def comparison_values(
    files: Sequence[Path], arms: Sequence[Arm], found: Comparison
) -> dict[str, Any]:
    """Put a comparison of two arms into plain values."""
    names = [joint.name for joint in arms[0].joints]
    return {
        "arms": [_provenance(file, arm) for file, arm in zip(files, arms, strict=True)],
        "n_postures": found.n_postures,
        "rms_mm": found.rms_mm,
        "median_mm": found.median_mm,
        "largest_mm": found.largest_mm,
        "largest_at_mm": found.largest_at_mm.tolist(),
        "largest_at_rad": dict(zip(names, found.largest_at_rad.tolist(), strict=True)),
        "taken_out": {"rms_mm": found.shift_rms_mm, "turn_rad": found.turn_rad},
        "zones": {
            zone.name: {
                "n_postures": zone.n_postures,
                "rms_mm": zone.rms_mm if zone.n_postures else None,
                "largest_mm": zone.largest_mm if zone.n_postures else None,
            }
            for zone in found.zones
        },
    }


def _provenance(file: Path, arm: "Arm") -> dict[str, Any]:
    made = arm.identification
    return {
        "file": str(file),
        "name": arm.name,
        "date": None if made is None or made.date is None else str(made.date),
        "sigma0": None if made is None else made.sigma0,
        "redundancy": None if made is None else made.redundancy,
        "effects": len(arm.effects),
    }
