"""Summary of an arm file in numbers."""

import math
from collections.abc import Mapping
from datetime import date
from typing import Any

import numpy as np

from traverse.kinematics.arm_file.arm import Arm, Joint, arm_digest
from traverse.kinematics.model.forward import joint_positions
from traverse.kinematics.model.geometry import Geometry, geometry_from_arm
from traverse.kinematics.model.origins import length_mm, near_origins
from traverse.plurals import counted


def arm_summary(arm: Arm) -> dict[str, Any]:
    """Sum an arm up as plain values.

    The reach of a joint is from its axis to the ball with everything behind it
    stretched out: the lever at which its encoder's step is largest.
    """
    geometry = geometry_from_arm(arm)
    near = near_origins(geometry)
    reaches_mm = _reaches_mm(near)
    posture_rad = geometry.zeros_rad[np.newaxis]
    ball_mm = joint_positions(geometry, posture_rad)[0, -1]
    links_mm = np.linalg.norm(geometry.links_mm, axis=1)
    return {
        "schema": "traverse/arm-summary/1",
        "name": arm.name,
        "digest": arm_digest(arm),
        "origin_mm": list(arm.origin_mm),
        "reach_mm": length_mm(near),
        "joints": [
            {
                "name": joint.name,
                "axis": geometry.axes[k].tolist(),
                "link_mm": float(links_mm[k]),
                "reach_mm": reaches_mm[k],
                "zero_rad": joint.zero_rad,
                **_encoder(joint, reaches_mm[k]),
                "mass_kg": joint.mass_kg,
                "coupled_to": joint.coupled_to,
                "ratio": joint.ratio,
            }
            for k, joint in enumerate(arm.joints)
        ],
        "probe": {
            "kind": arm.probe.kind,
            "radius_mm": arm.probe.radius_mm,
            "vector_mm": list(arm.probe.vector_mm),
            "direction": geometry.probe_direction.tolist(),
            "base_posture_mm": ball_mm.tolist(),
        },
        "reference": arm.reference.model_dump(),
        "effects": [effect.model_dump(exclude_none=True) for effect in arm.effects],
        "identification": arm.identification.model_dump(exclude_none=True)
        if arm.identification
        else None,
    }


def summary_lines(summary: Mapping[str, Any]) -> list[str]:
    probe = summary["probe"]
    joints = summary["joints"]
    width = max(5, *(len(joint["name"]) for joint in joints))
    link, reach = (
        max(least, *(len(f"{joint[key]:.3f}") + 2 for joint in joints))
        for key, least in (("link_mm", 10), ("reach_mm", 11))
    )
    head = f"{'joint':<{width}}  {'axis in the base posture':^26}{'link':>{link}}"
    units = f"{'':<{width}}  {'x':>8} {'y':>8} {'z':>8}{'mm':>{link}}{'mm':>{reach}}"
    lines = [
        f"{summary['name']}: {counted(len(joints), 'joint')}, "
        f"reach {summary['reach_mm']:.1f} mm, "
        f"digest {summary['digest'][:12]}",
        "",
        f"{head}{'reach':>{reach}}{'counts':>14}{'step at reach':>16}",
        f"{units}{'a turn':>14}{'um':>16}",
        *(_joint_line(joint, (width, link, reach)) for joint in joints),
        "",
        *(
            f"{joint['name']} turns with {joint['coupled_to']} by {joint['ratio']:g}"
            for joint in joints
            if joint["coupled_to"]
        ),
        f"base at   {_vector(summary['origin_mm'])} mm",
        f"ball at   {_vector(probe['base_posture_mm'])} mm in the base posture",
        f"probe     {probe['kind']}, radius {probe['radius_mm']:g} mm, shank "
        f"{_vector(probe['direction'], 4)}",
    ]
    effects = summary["effects"]
    lines.append(f"effects   {len(effects) or 'none'}")
    lines += [f"  {_pairs(effect)}" for effect in effects]
    identified = summary["identification"]
    lines.append(f"identified{'' if identified else ' never'}")
    lines += [f"  {key}: {_shown(value)}" for key, value in (identified or {}).items()]
    return lines


def _reaches_mm(geometry: Geometry) -> list[float]:
    links_mm = geometry.links_mm.copy()
    links_mm[-1] += geometry.probe_vector_mm
    lengths_mm = np.linalg.norm(links_mm, axis=1)
    beyond_mm = lengths_mm.sum() - np.cumsum(lengths_mm)
    # A joint's own link keeps its angle to the axis: only the part across it counts.
    across_mm = np.linalg.norm(np.cross(geometry.axes, links_mm), axis=1)
    return [float(reach) for reach in across_mm + beyond_mm]


def _encoder(joint: Joint, reach_mm: float) -> dict[str, Any]:
    encoder = joint.encoder
    if encoder is None:
        return {"counts_per_turn": None, "step_at_reach_um": None}
    step_rad = 2.0 * math.pi / encoder.counts_per_turn
    return {
        "counts_per_turn": encoder.counts_per_turn,
        "sign": encoder.sign,
        "source": encoder.source,
        "step_at_reach_um": 1000.0 * step_rad * reach_mm,
    }


def _joint_line(joint: Mapping[str, Any], widths: tuple[int, int, int]) -> str:
    width, link, reach = widths
    x, y, z = joint["axis"]
    counts, step_um = joint["counts_per_turn"], joint["step_at_reach_um"]
    encoder = f"{counts:>14d}{step_um:>16.3f}" if counts else f"{'none':>14}{'-':>16}"
    return (
        f"{joint['name']:<{width}}  {x:8.4f} {y:8.4f} {z:8.4f}"
        f"{joint['link_mm']:{link}.3f}{joint['reach_mm']:{reach}.3f}{encoder}"
    )


def _vector(vector: list[float], decimals: int = 3) -> str:
    # Adding zero turns -0.0 into 0.0.
    return " ".join(f"{round(x, decimals) + 0.0:.{decimals}f}" for x in vector)


def _pairs(values: Mapping[str, Any]) -> str:
    return " ".join(f"{key}={_shown(value)}" for key, value in values.items())


def _shown(value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_shown, value))}]"
    return value.isoformat() if isinstance(value, date) else str(value)
