"""A chain of robot description joints as an arm: frames merged, masses gathered.

A joint of a URDF places its child's frame in its parent's by an `origin`, xyz and
roll-pitch-yaw (R = R_z(yaw) R_y(pitch) R_x(roll)), and turns it about an `axis`
written in the child's frame. Here lengths are mm already.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.geometry import Geometry, unit_vectors
from traverse.kinematics.model.quaternion import rotation_matrix, turn


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A mass at a place.

    Attributes:
        mass_kg: Not negative.
        centre_mm: Centre of mass in the body's frame, (3,).
    """

    mass_kg: float
    centre_mm: Floats


class Mimic(NamedTuple):
    """A joint without a drive of its own: it turns by ratio times another, plus."""

    joint: str
    ratio: float
    offset_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class ChainJoint:
    """A joint between two frames, with the bodies fixed to the frame behind it.

    Attributes:
        origin: Transform from the child's frame to the parent's, not turned, (4, 4).
        axis: In the child's frame, any length > 0, (3,); nothing for a fixed joint.
        bodies: On the child, in the child's frame.
        mimic: Of a turning joint that follows another one of the chain.
    """

    name: str
    origin: Floats
    axis: Floats | None
    bodies: tuple[Body, ...] = ()
    mimic: Mimic | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ChainArm:
    """A chain with its fixed joints merged away.

    Attributes:
        geometry: The arm; the probe is the tip's origin moved by the tool.
        names: Of the turning joints, (n_joints).
        bodies: What each joint carries as one body, from the joint's origin in the base
            posture; empty if the description has no mass, (n_joints).
        mimics: The joint that each one follows, (n_joints).
    """

    geometry: Geometry
    names: tuple[str, ...]
    bodies: tuple[Body | None, ...]
    mimics: tuple[Mimic | None, ...]


def arm_from_chain(
    chain: Sequence[ChainJoint], tool: Floats, base_posture_rad: Floats
) -> ChainArm:
    """Merge a chain from the root to the tip into an arm.

    What a joint carries reaches up to the next turning joint; links before the
    first one do not move and are left out.

    Args:
        chain: From the root outwards, at least one joint that turns.
        tool: Transform from the probe, z along the shank, to the tip's frame, (4, 4).
        base_posture_rad: Readings of the posture to write it in, (n_joints,); of
            joints that follow others those that they have then.
    """
    turning = [joint for joint in chain if joint.axis is not None]
    names = tuple(joint.name for joint in turning)
    posture_rad = base_posture_rad.copy()
    for k, joint in enumerate(turning):
        if joint.mimic is not None:
            led_rad = base_posture_rad[names.index(joint.mimic.joint)]
            posture_rad[k] = joint.mimic.ratio * led_rad + joint.mimic.offset_rad
    pose = np.eye(4)
    axes: list[Floats] = []
    origins_mm: list[Floats] = []
    carried: list[list[Body]] = []
    for joint in chain:
        pose = pose @ joint.origin
        if joint.axis is not None:
            axis = unit_vectors(joint.axis)
            axes.append(pose[:3, :3] @ axis)
            origins_mm.append(pose[:3, 3])
            pose = pose @ turned_by(axis, float(posture_rad[len(carried)]))
            carried.append([])
        if carried:
            carried[-1] += [moved_body(pose, body) for body in joint.bodies]
    ends_mm = np.array([*origins_mm, pose[:3, 3]])
    geometry = Geometry(
        origin_mm=ends_mm[0],
        axes=unit_vectors(axes),
        links_mm=np.diff(ends_mm, axis=0),
        zeros_rad=posture_rad,
        probe_vector_mm=pose[:3, :3] @ tool[:3, 3],
        probe_direction=unit_vectors(pose[:3, :3] @ tool[:3, 2]),
    )
    return ChainArm(
        geometry,
        names,
        tuple(map(_one_body, carried, origins_mm)),
        tuple(joint.mimic for joint in turning),
    )


def moved_body(pose: Floats, body: Body) -> Body:
    """Write a body in another frame; `pose` maps its frame to that one, (4, 4)."""
    return Body(body.mass_kg, pose[:3, :3] @ body.centre_mm + pose[:3, 3])


def transform(xyz_mm: Sequence[float], rpy_rad: Sequence[float]) -> Floats:
    """Make a transform of a shift and roll, pitch, yaw: (4, 4) [mm]."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy_rad), np.sin(rpy_rad)
    placed = np.eye(4)
    placed[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    placed[:3, 3] = xyz_mm
    return placed


def roll_pitch_yaw(rotation: Floats) -> Floats:
    """Read roll, pitch and yaw off a rotation: (3, 3) -> (3,) [rad].

    With the pitch at a quarter turn only roll minus or plus yaw exists: yaw is 0 then.
    Near it each of them is uncertain, so roll is what the yaw leaves over.
    """
    cosine = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0]) if cosine > 1e-12 else 0.0
    left = np.cos(yaw) * rotation[1] - np.sin(yaw) * rotation[0]
    roll, pitch = np.arctan2(-left[2], left[1]), np.arctan2(-rotation[2, 0], cosine)
    return np.array([roll, pitch, yaw])


def turned_by(axis: Floats, angle_rad: float) -> Floats:
    """Make the transform that turns about an axis through the origin, (4, 4)."""
    turned = np.eye(4)
    turned[:3, :3] = rotation_matrix(turn(axis, np.array(angle_rad)))
    return turned


def _one_body(bodies: Sequence[Body], origin_mm: Floats) -> Body | None:
    mass_kg = sum(body.mass_kg for body in bodies)
    if mass_kg <= 0.0:
        return None
    moment = sum((body.mass_kg * body.centre_mm for body in bodies), np.zeros(3))
    return Body(mass_kg, moment / mass_kg - origin_mm)
