"""Denavit-Hartenberg tables: to an arm's base posture, and back to the nearest table.

A row is a product of elementary motions, theta = offset + reading:

    classic   Rot_z(theta) Trans_z(d) Trans_x(a) Rot_x(alpha)
    modified  Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d)        (Craig)

so either is  before . Rot_z(theta) . after,  and the hinge is the z axis behind
`before`. With a base and a tool transform of its own a table can hold every arm, but
not well: see `nearest_table`.
"""

from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import Geometry, unit_vectors

Convention = Literal["classic", "modified"]

# A shank within this of the last hinge is taken as parallel to it; the tool transform
# takes the rest, so nothing is lost.
_SHANK_SINE = 0.1
# Parallel hinges closer than this part of the arm's size are one line.
_SAME_LINE = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class DHTable:
    """A table with the transforms before and behind it; arrays are read-only.

    Attributes:
        convention: Order of the motions in a row.
        a_mm: (n_joints,).
        d_mm: (n_joints,).
        alpha_rad: (n_joints,).
        theta_rad: theta where the reading is zero, (n_joints,).
        base: Transform from the table's first frame to the arm's system, (4, 4) [mm].
        tool: Transform from the probe, z along the shank, to the last frame, (4, 4).
    """

    convention: Convention
    a_mm: Floats
    d_mm: Floats
    alpha_rad: Floats
    theta_rad: Floats
    base: Floats
    tool: Floats

    def __post_init__(self) -> None:
        for field in fields(self)[1:]:
            array = np.array(getattr(self, field.name), dtype=np.float64)
            square = field.name in ("base", "tool")
            expected = (4, 4) if square else (len(self.a_mm),)
            if array.shape != expected:
                raise ValueError(
                    f"DH table: {field.name} has shape {array.shape}, expected "
                    f"{expected}"
                )
            array.setflags(write=False)
            object.__setattr__(self, field.name, array)

    @property
    def n_joints(self) -> int:
        return len(self.a_mm)


@dataclass(frozen=True, slots=True, eq=False)
class NearestTable:
    """The classic table nearest to an arm, and how firmly each pair of hinges holds it.

    Attributes:
        table: Classic, with the base and tool transforms that it needs.
        between_rad: Angle between the lines of hinge k and k+1, 0 to pi/2,
            (n_joints - 1,).
        parallel: Whether the pair was taken as parallel, (n_joints - 1,) bool.
        slide_mm_rad: How far the common normal slides along the hinges when one of
            them tilts; 0 for a pair taken as parallel, (n_joints - 1,).
    """

    table: DHTable
    between_rad: Floats
    parallel: Booleans
    slide_mm_rad: Floats


def geometry_from_dh(table: DHTable, base_posture_rad: Floats) -> Geometry:
    """Write a table as the geometry of an arm.

    A joint has the origin of the frame behind `before`: the foot of the common
    normal from the hinge before.

    Args:
        table: Either convention.
        base_posture_rad: Readings of the posture to write it in, (n_joints,).
    """
    before, after = _fixed_parts(table)
    pose = table.base
    hinges = []
    for k in range(table.n_joints):
        hinge = pose @ before[k]
        hinges.append(hinge)
        pose = hinge @ _turn_z(table.theta_rad[k] + base_posture_rad[k]) @ after[k]
    origins_mm = np.array([*(hinge[:3, 3] for hinge in hinges), pose[:3, 3]])
    return Geometry(
        origin_mm=origins_mm[0],
        axes=unit_vectors([hinge[:3, 2] for hinge in hinges]),
        links_mm=np.diff(origins_mm, axis=0),
        zeros_rad=base_posture_rad,
        probe_vector_mm=pose[:3, :3] @ table.tool[:3, 3],
        probe_direction=unit_vectors(pose[:3, :3] @ table.tool[:3, 2]),
    )


def probe_transforms(table: DHTable, angles_rad: Floats) -> Floats:
    """Multiply a table out: (n_samples, n_joints) -> (n_samples, 4, 4) [mm]."""
    before, after = _fixed_parts(table)
    poses = np.broadcast_to(table.base, (len(angles_rad), 4, 4))
    for k in range(table.n_joints):
        turns = _turn_z(table.theta_rad[k] + angles_rad[:, k])
        poses = poses @ before[k] @ turns @ after[k]
    return poses @ table.tool


def misfits_mm(geometry: Geometry, table: DHTable, angles_rad: Floats) -> Floats:
    """Compare an arm with a table at the probe.

    Args:
        geometry: The arm.
        table: Of as many joints.
        angles_rad: Readings, (n_samples, n_joints).

    Returns:
        Distances between the two centres of the ball, (n_samples,).
    """
    centres_mm, _ = probe_pose(geometry, angles_rad)
    gaps_mm = probe_transforms(table, angles_rad)[:, :3, 3] - centres_mm
    misfits: Floats = np.linalg.norm(gaps_mm, axis=1)
    return misfits


def nearest_table(geometry: Geometry, parallel_below_rad: float) -> NearestTable:
    """Draw the common normals of an arm's hinges and read the classic table off them.

    The common normal of two hinges at an angle phi is where their lines are
    closest, which slides by 1/phi^2 with their tilt: for hinges made parallel, but
    measured at 1e-4 rad, it is metres away from the arm and d says nothing about
    the arm's build. Exactly parallel hinges have it anywhere. Hinges within
    `parallel_below_rad` are therefore taken as parallel (alpha 0 or pi), with the
    normal drawn where the one before ends (d = 0): the shortest table. That is the
    only misfit of the table, and it vanishes in the base posture.

    Free choices: the first frame is at x_0 with its x axis along the arm's own as
    nearly as may be; x axes point so that theta offsets stay within a quarter turn (a
    may be negative); behind the last hinge the shank takes the part of a next one.
    """
    n = geometry.n_joints
    ends_mm = geometry.origin_mm + np.vstack(
        [np.zeros(3), np.cumsum(geometry.links_mm, axis=0)]
    )
    size_mm = float(np.linalg.norm(geometry.links_mm, axis=1).sum())
    lines = [*geometry.axes, geometry.probe_direction]
    base = _frame(lines[0], ends_mm[0])
    foot_mm, x_axis = base[:3, 3], base[:3, 0]
    rows, pairs = [], []
    for k in range(n):
        u, v = lines[k], lines[k + 1]
        gap_mm = ends_mm[k + 1] - foot_mm
        cross = np.cross(u, v)
        sine, cosine = float(np.linalg.norm(cross)), float(u @ v)
        last = k == n - 1
        parallel = sine < (_SHANK_SINE if last else np.sin(parallel_below_rad))
        if parallel:
            d_mm = float(gap_mm @ u) if last else 0.0
            across_mm = gap_mm - (gap_mm @ u) * u
            a_mm = float(np.linalg.norm(across_mm))
            alpha = 0.0 if cosine > 0.0 else np.pi
            foot_mm = ends_mm[k + 1] - ((gap_mm - d_mm * u) @ v) * v
            if a_mm <= _SAME_LINE * size_mm:
                # One line: the offset of theta is free, and zero is the plainest.
                zero_rad = geometry.zeros_rad[k]
                a_mm, normal = 0.0, np.cos(zero_rad) * x_axis
                normal = normal + np.sin(zero_rad) * np.cross(u, x_axis)
            else:
                normal = across_mm / a_mm
            slide_mm_rad = 0.0
        else:
            normal = cross / sine
            alpha = float(np.arctan2(sine, cosine))
            a_mm = float(gap_mm @ normal)
            d_mm = float(np.cross(gap_mm, v) @ normal) / sine
            along_mm = float(np.cross(gap_mm, u) @ normal) / sine
            foot_mm = ends_mm[k + 1] + along_mm * v
            slide_mm_rad = float(np.hypot(a_mm, along_mm * sine)) / sine**2
        theta = float(np.arctan2(np.cross(x_axis, normal) @ u, x_axis @ normal))
        offset = _wrapped(theta - float(geometry.zeros_rad[k]))
        if abs(offset) > 0.5 * np.pi + 1e-9:
            offset, normal, a_mm = _wrapped(offset + np.pi), -normal, -a_mm
            alpha = alpha if parallel else -alpha
        rows.append((a_mm, d_mm, alpha, offset))
        pairs.append((np.arctan2(sine, abs(cosine)), parallel, slide_mm_rad))
        x_axis = normal
    a, d, alphas, offsets = np.array(rows).T
    bare = DHTable("classic", a, d, alphas, offsets, base, np.eye(4))
    between, is_parallel, slides = np.array(pairs[: n - 1]).reshape(-1, 3).T
    return NearestTable(_with_tool(bare, geometry), between, is_parallel > 0.5, slides)


def _with_tool(bare: DHTable, geometry: Geometry) -> DHTable:
    """Add the tool transform that puts the probe right in the base posture."""
    posture_rad = geometry.zeros_rad[np.newaxis]
    flange = probe_transforms(bare, posture_rad)[0]
    centre_mm, shank = probe_pose(geometry, posture_rad)
    z_axis = flange[:3, :3].T @ shank[0]
    tool_mm = flange[:3, :3].T @ (centre_mm[0] - flange[:3, 3])
    return replace(bare, tool=_frame(z_axis, tool_mm))


def _fixed_parts(table: DHTable) -> tuple[Floats, Floats]:
    """Make `before` and `after` of every row, (n_joints, 4, 4) each."""
    n = table.n_joints
    across = np.broadcast_to(np.eye(4), (n, 4, 4)).copy()
    cosines, sines = np.cos(table.alpha_rad), np.sin(table.alpha_rad)
    across[:, 0, 3] = table.a_mm
    across[:, 1, 1] = across[:, 2, 2] = cosines
    across[:, 1, 2], across[:, 2, 1] = -sines, sines
    along = np.broadcast_to(np.eye(4), (n, 4, 4)).copy()
    along[:, 2, 3] = table.d_mm
    if table.convention == "modified":
        return across, along
    return np.broadcast_to(np.eye(4), (n, 4, 4)), along @ across


def _turn_z(angles_rad: Floats) -> Floats:
    """Make Rot_z: (...) -> (..., 4, 4)."""
    turns = np.zeros((*np.shape(angles_rad), 4, 4))
    turns[..., 0, 0] = turns[..., 1, 1] = np.cos(angles_rad)
    turns[..., 1, 0] = np.sin(angles_rad)
    turns[..., 0, 1] = -turns[..., 1, 0]
    turns[..., 2, 2] = turns[..., 3, 3] = 1.0
    return turns


def _frame(z_axis: Floats, origin_mm: Floats) -> Floats:
    """Make a transform with a given z axis, x as near to the x axis as may be."""
    seed = np.eye(3)[0 if abs(z_axis[0]) < 0.9 else 1]
    x_axis = unit_vectors(seed - (seed @ z_axis) * z_axis)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([x_axis, np.cross(z_axis, x_axis), z_axis])
    frame[:3, 3] = origin_mm
    return frame


def _wrapped(angle_rad: float) -> float:
    """Bring an angle to -pi < angle <= pi."""
    return float(np.pi - (np.pi - angle_rad) % (2.0 * np.pi))
