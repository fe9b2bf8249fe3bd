"""An arm file's values from a geometry and the bodies on each joint."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm, parse_arm
from traverse.kinematics.importers.urdf import Body, Mimic
from traverse.kinematics.model.geometry import Geometry
from traverse.strict_toml.rewriting import rewritten_text

# Arm files from tables show 1 and not 0.9999999999999999: no arm is that accurate.
RAD_DECIMALS = 15
MM_DECIMALS = 12


@dataclass(frozen=True, slots=True, eq=False)
class JointParts:
    """Keys of a joint in an arm file beside its geometry; None is left out.

    Attributes:
        name: Unique in the arm.
        counts_per_turn: Of its encoder; without it the joint has no encoder.
        sign: +1 or -1: which way the encoder counts.
        source: "<device id>/<channel>".
        absolute: Whether its count is right again after a loss of power; None: not
            known, so that the daemon asks for a confirmation after each start.
        body: Mass and its centre from the joint's origin in the base posture.
        mimic: The joint that it follows, without an encoder.
    """

    name: str
    counts_per_turn: int | None
    sign: int
    source: str
    body: Body | None = None
    mimic: Mimic | None = None
    absolute: bool | None = None


def assemble_arm(
    name: str,
    geometry: Geometry,
    joints: Sequence[JointParts],
    source: str,
    *,
    radius_mm: float,
    probe_kind: str = "hard",
) -> Arm:
    """Put an arm together, at 20 degrees Celsius and gravity along -z.

    The probe has a ball of this radius and is of this kind.

    Raises:
        FileError: A value is not allowed in an arm file; lists all, for `source`.
    """
    values = {
        "schema": "traverse/arm/1",
        "name": name,
        "origin_mm": rounded(geometry.origin_mm, MM_DECIMALS),
        "joints": [_joint(geometry, k, parts) for k, parts in enumerate(joints)],
        "probe": {
            "radius_mm": radius_mm,
            "kind": probe_kind,
            "vector_mm": rounded(geometry.probe_vector_mm, MM_DECIMALS),
            "direction": rounded(geometry.probe_direction, RAD_DECIMALS),
        },
        "reference": {"temperature_c": 20.0, "gravity_m_s2": [0.0, 0.0, -9.80665]},
    }
    return parse_arm(rewritten_text(values), source)


def _joint(geometry: Geometry, k: int, parts: JointParts) -> dict[str, Any]:
    joint: dict[str, Any] = {
        "name": parts.name,
        "axis": rounded(geometry.axes[k], RAD_DECIMALS),
        "link_mm": rounded(geometry.links_mm[k], MM_DECIMALS),
        "zero_rad": float(geometry.zeros_rad[k]),
    }
    if parts.body is not None:
        joint["mass_kg"] = parts.body.mass_kg
        joint["centre_of_mass_mm"] = rounded(parts.body.centre_mm, MM_DECIMALS)
    if parts.mimic is not None:
        joint |= {"coupled_to": parts.mimic.joint, "ratio": parts.mimic.ratio}
    elif parts.counts_per_turn is not None:
        joint["encoder"] = {
            "counts_per_turn": parts.counts_per_turn,
            "sign": parts.sign,
            "source": parts.source,
        }
        if parts.absolute is not None:
            joint["encoder"]["absolute"] = parts.absolute
    return joint


def rounded(vector: Floats, decimals: int) -> list[float]:
    """Round a vector (n,) as in a file; adding zero turns -0.0 into 0.0."""
    return [round(float(value), decimals) + 0.0 for value in vector]
