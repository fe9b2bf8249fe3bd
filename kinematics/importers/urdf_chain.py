"""The chain of a robot description that becomes an arm.

From the root link to the tip; joints that are held at a value count as fixed, joints
that mimic another one lead back to the joint that turns freely.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NoReturn

import numpy as np

from traverse.kinematics.importers.urdf import (
    Body,
    ChainJoint,
    Mimic,
    moved_body,
    turned_by,
)
from traverse.kinematics.importers.urdf_file import Robot, UrdfJoint
from traverse.kinematics.model.geometry import unit_vectors
from traverse.strict_toml.problems import (
    FileError,
    Problem,
    shown,
    unknown_name_message,
)

_TURNING = ("revolute", "continuous")
_WHY_NOT = {
    "prismatic": "it slides, and an arm has hinges only",
    "floating": "nothing holds it, so no encoder can tell where it is",
    "planar": "it slides, and an arm has hinges only",
}


@dataclass(frozen=True, slots=True)
class Holds:
    """Joints that are held at a value, by name."""

    mm: Mapping[str, float] = field(default_factory=dict)
    rad: Mapping[str, float] = field(default_factory=dict)


def chain_of(
    robot: Robot, root: str | None, tip: str | None, holds: Holds | None = None
) -> list[ChainJoint]:
    """Walk from the root link to the tip link.

    Args:
        robot: As described.
        root: Link of the arm's base; the only root if None.
        tip: The link that carries the probe; the only end if None.
        holds: Joints that count as fixed.

    Raises:
        FileError: There is not one such chain, or it is no arm's; names the choices.
    """
    robot = _held(robot, holds or Holds())
    path = _path(robot, root, tip)
    free = [j.name for j in path if j.kind in _TURNING and j.mimic is None]
    path = [_with_free_master(joint, robot, free) for joint in path]
    problems = [problem for joint in path for problem in _joint_problems(joint, free)]
    if not any(joint.kind in _TURNING for joint in path):
        ends = f"chain {path[0].parent} to {path[-1].child}"
        problems.append(Problem(ends, "no joint turns; an arm has at least one"))
    if problems:
        raise FileError(robot.source, problems)
    on_chain = {joint.child for joint in path}
    fixed: dict[str, list[UrdfJoint]] = {}
    for joint in robot.joint_of_child.values():
        if joint.kind == "fixed" and joint.child not in on_chain:
            fixed.setdefault(joint.parent, []).append(joint)
    return [
        ChainJoint(
            name=joint.name,
            origin=joint.origin,
            axis=joint.axis if joint.kind in _TURNING else None,
            bodies=tuple(_bodies(robot, joint.child, fixed)),
            mimic=joint.mimic if joint.kind in _TURNING else None,
        )
        for joint in path
    ]


def _held(robot: Robot, holds: Holds) -> Robot:
    """Fix the joints that are held, and those that mimic one of them.

    Raises:
        FileError: There is no such joint, or it moves otherwise.
    """
    joints = {joint.name: joint for joint in robot.joint_of_child.values()}
    problems = []
    # As in the description: m and rad.
    values: dict[str, float] = {}
    for option, held, kinds, factor in (
        ("--hold-mm", holds.mm, ("prismatic",), 1e-3),
        ("--hold-rad", holds.rad, _TURNING, 1.0),
    ):
        for name, value in held.items():
            if name not in joints:
                message = unknown_name_message("joint", name, joints)
                problems.append(Problem(option, message))
            elif joints[name].kind not in kinds:
                expected = " or ".join(kinds)
                problem = (
                    f"joint {shown(name)} is {joints[name].kind}, expected {expected}"
                )
                problems.append(Problem(option, problem))
            else:
                values[name] = factor * value
    if problems:
        raise FileError(robot.source, problems)
    for name in joints:
        master, ratio, offset = _master(name, joints)
        if master in values and name not in values and master != name:
            values[name] = ratio * values[master] + offset
    if not values:
        return robot
    return replace(
        robot,
        joint_of_child={
            child: _fixed_at(joint, values[joint.name])
            if joint.name in values
            else joint
            for child, joint in robot.joint_of_child.items()
        },
    )


def _master(name: str, joints: Mapping[str, UrdfJoint]) -> tuple[str, float, float]:
    """Follow a mimic to the last joint that it leads to; value = ratio master + offset.

    A ring of mimics leads to one of its joints, which is none that turns freely.
    """
    ratio, offset, passed = 1.0, 0.0, {name}
    while name in joints and (mimic := joints[name].mimic) is not None:
        ratio, offset = ratio * mimic.ratio, offset + ratio * mimic.offset_rad
        name = mimic.joint
        if name in passed:
            break
        passed.add(name)
    return name, ratio, offset


def _with_free_master(joint: UrdfJoint, robot: Robot, free: Sequence[str]) -> UrdfJoint:
    """Let a joint that mimics a mimic follow the one that turns freely."""
    if joint.mimic is None or joint.kind not in _TURNING or joint.mimic.joint in free:
        return joint
    joints = {candidate.name: candidate for candidate in robot.joint_of_child.values()}
    master, ratio, offset_rad = _master(joint.name, joints)
    if master not in free or ratio == 0.0:
        return joint
    return replace(joint, mimic=Mimic(master, ratio, offset_rad))


def _fixed_at(joint: UrdfJoint, value: float) -> UrdfJoint:
    """Fix a joint at a value, in m or rad."""
    axis = unit_vectors(joint.axis)
    if joint.kind == "prismatic":
        motion = np.eye(4)
        motion[:3, 3] = 1000.0 * value * axis
    else:
        motion = turned_by(axis, value)
    return replace(joint, kind="fixed", origin=joint.origin @ motion, mimic=None)


def _path(robot: Robot, root: str | None, tip: str | None) -> list[UrdfJoint]:
    """Find the joints from the root to the tip, in that order."""
    for option, link in (("--root", root), ("--tip", tip)):
        if link is not None and link not in robot.links:
            _refuse(robot, option, unknown_name_message("link", link, robot.links))
    parents = {joint.parent for joint in robot.joint_of_child.values()}
    tips = [tip] if tip else [name for name in robot.links if name not in parents]
    ways_up = {end: _way_up(robot, end, root) for end in tips}
    ways = {end: way for end, way in ways_up.items() if way}
    if not ways:
        problem = (
            f"no chain of joints leads from {shown(root) if root else 'a root'} to "
        )
        _refuse(robot, "", f"{problem}{shown(tip) if tip else 'an end'}")
    if len(ways) > 1:
        # Ends that only fixed joints lead to are parts of the base.
        ways = {end: way for end, way in ways.items() if _turns(way)} or ways
    if len(ways) > 1:
        ends = ", ".join(f"{end} ({_turns(way)} turning)" for end, way in ways.items())
        _refuse(robot, "", f"holds several chains; say --tip LINK, one of: {ends}")
    return next(iter(ways.values()))


def _way_up(robot: Robot, tip: str, root: str | None) -> list[UrdfJoint] | None:
    """Walk from a tip to the root and turn the way round; None if it is not met."""
    way: list[UrdfJoint] = []
    passed: set[str] = set()
    link = tip
    while link != root and link in robot.joint_of_child:
        joint = robot.joint_of_child[link]
        if link in passed:
            problem = f"joint {shown(joint.name)} is in a ring; an arm is an open chain"
            _refuse(robot, f"line {joint.line}", problem)
        passed.add(link)
        way.append(joint)
        link = joint.parent
    return way[::-1] if root is None or link == root else None


def _turns(way: list[UrdfJoint]) -> int:
    return sum(joint.kind in _TURNING for joint in way)


def _joint_problems(joint: UrdfJoint, free: Sequence[str]) -> Iterator[Problem]:
    where = f"line {joint.line}"
    if joint.kind in _WHY_NOT:
        problem = f"joint {shown(joint.name)} is {joint.kind}: {_WHY_NOT[joint.kind]}"
        hold = f"hold it by --hold-mm {joint.name}=VALUE, "
        hold = hold if joint.kind == "prismatic" else ""
        yield Problem(
            where, f"{problem}; {hold}make it fixed, or choose --root and --tip"
        )
    mimic = joint.mimic if joint.kind in _TURNING else None
    if mimic is not None and mimic.joint not in free:
        problem = (
            f"joint {shown(joint.name)} mimics {shown(mimic.joint)}; expected a joint"
        )
        hold = f"or hold it by --hold-rad {joint.name}=VALUE"
        known = ", ".join(free) or "none"
        yield Problem(
            where, f"{problem} of the chain that turns freely: {known}; {hold}"
        )


def _bodies(
    robot: Robot, link: str, fixed: Mapping[str, list[UrdfJoint]]
) -> Iterator[Body]:
    """Return a link's bodies, with all that is fixed to it beside the chain."""
    pending = [(link, np.eye(4))]
    while pending:
        name, pose = pending.pop()
        body = robot.links[name]
        if body is not None:
            yield moved_body(pose, body)
        pending += [(j.child, pose @ j.origin) for j in fixed.get(name, ())]


def _refuse(robot: Robot, where: str, problem: str) -> NoReturn:
    raise FileError(robot.source, [Problem(where, problem)])
