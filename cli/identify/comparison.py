"""Results of `traverse identify --compare`: plain values, and lines of them."""

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


def comparison_lines(values: dict[str, Any]) -> list[str]:
    """Describe in words how two arms differ."""
    lines = []
    for letter, one in zip("AB", values["arms"], strict=True):
        quality = (
            "design, not identified"
            if one["sigma0"] is None
            else f"identified {one['date']}, sigma0 {one['sigma0']:.3g}, redundancy "
            f"{one['redundancy']}"
        )
        lines.append(f"{letter}: {one['file']}: {one['name']}, {quality}")
    angles = ", ".join(
        f"{name} {angle:.4f}" for name, angle in values["largest_at_rad"].items()
    )
    x, y, z = values["largest_at_mm"]
    lines += [
        f"at the probe, over {values['n_postures']} postures, the arms' own placing "
        f"taken out ({values['taken_out']['rms_mm']:.4f} mm rms with it):",
        f"rms {values['rms_mm']:.4f} mm, median {values['median_mm']:.4f} mm, largest "
        f"{values['largest_mm']:.4f} mm",
        f"largest at x {x:.1f}, y {y:.1f}, z {z:.1f} mm: {angles} rad",
    ]
    lines += [
        f"{name}: rms {zone['rms_mm']:.4f} mm, largest {zone['largest_mm']:.4f} mm "
        f"({zone['n_postures']} postures)"
        for name, zone in values["zones"].items()
        if zone["n_postures"]
    ]
    if any(one["effects"] for one in values["arms"]):
        lines.append("effects in the arm files were not compared, geometry only")
    return lines


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
