"""How well a Denavit-Hartenberg table represents an arm."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.importers.dh import misfits_mm, nearest_table
from traverse.kinematics.importers.dh_file import dh_csv, dh_values
from traverse.kinematics.model.geometry import Geometry, geometry_from_arm

# Axes are identified to about this; more than a tenth of a millimetre of slide from it
# makes d and theta a matter of chance.
_TILT_RAD = 1e-5
_SLIDE_MM = 0.1


def dh_report(
    arm: Arm, parallel_below_rad: float, postures: int, seed: int
) -> tuple[dict[str, Any], str]:
    """Find the nearest table of an arm and measure it at the probe.

    Args:
        arm: Any.
        parallel_below_rad: Hinges nearer to parallel than this are taken as parallel.
        postures: How many random ones, each joint within half a turn of its zero.
        seed: Of the postures.

    Returns:
        The report as plain values, and the table as CSV with the report in comments.
    """
    geometry = replace(geometry_from_arm(arm), couplings=())
    nearest = nearest_table(geometry, parallel_below_rad)
    names = [joint.name for joint in arm.joints]
    zeros_rad = [joint.zero_rad for joint in arm.joints]
    readings_rad = random_readings_rad(geometry, postures, seed)
    misfit_mm = misfits_mm(geometry, nearest.table, readings_rad)
    kept = {
        "encoders": any(joint.encoder for joint in arm.joints),
        "masses": any(joint.mass_kg is not None for joint in arm.joints),
        "effects": bool(arm.effects),
        "couplings": any(joint.coupled_to for joint in arm.joints),
        "ball radius": arm.probe.radius_mm > 0.0,
        "identification": arm.identification is not None,
    }
    report = {
        "schema": "traverse/dh-report/1",
        "arm": arm.name,
        "table": dh_values(arm.name, nearest.table, names, zeros_rad),
        "misfit_mm": sizes_mm(misfit_mm, seed),
        "pairs": [
            {
                "joints": [names[k], names[k + 1]],
                "between_rad": float(nearest.between_rad[k]),
                "parallel": bool(nearest.parallel[k]),
                "slide_mm_per_rad": float(nearest.slide_mm_rad[k]),
                "ill_conditioned": bool(
                    nearest.slide_mm_rad[k] * _TILT_RAD > _SLIDE_MM
                ),
            }
            for k in range(geometry.n_joints - 1)
        ],
        "not_in_table": [part for part, is_there in kept.items() if is_there],
    }
    remarks = "".join(f"# {line}\n" for line in remark_lines(report))
    return report, dh_csv(nearest.table, names, zeros_rad) + remarks


def random_readings_rad(geometry: Geometry, postures: int, seed: int) -> Floats:
    """Draw postures within half a turn of the zeros: (postures, n_joints)."""
    shape = (postures, geometry.n_joints)
    turns_rad = np.random.default_rng(seed).uniform(-np.pi, np.pi, shape)
    return geometry.zeros_rad + turns_rad


def sizes_mm(distances_mm: Floats, seed: int) -> dict[str, float]:
    """Sum up distances over random postures, (n_postures,)."""
    return {
        "rms": float(np.sqrt(np.mean(distances_mm**2))),
        "max": float(np.max(distances_mm)),
        "postures": len(distances_mm),
        "seed": seed,
    }


def remark_lines(report: Mapping[str, Any]) -> Iterator[str]:
    misfit = report["misfit_mm"]
    yield (
        f"misfit at the probe over {misfit['postures']} random postures: rms "
        f"{misfit['rms']:.3g} mm, largest {misfit['max']:.3g} mm"
    )
    for pair in report["pairs"]:
        joints = " and ".join(pair["joints"])
        if pair["parallel"]:
            yield f"{joints} are {pair['between_rad']:.3g} rad apart: taken as parallel"
        elif pair["ill_conditioned"]:
            slide_mm = pair["slide_mm_per_rad"] * _TILT_RAD
            yield (
                f"{joints} are {pair['between_rad']:.3g} rad apart: {_TILT_RAD:g} "
                f"rad of tilt slide their common normal by {slide_mm:.3g} mm, so d "
                "and theta beside it say little; --parallel-below-rad takes them as "
                "parallel"
            )
    if report["not_in_table"]:
        yield f"not in a table: {', '.join(report['not_in_table'])}"
