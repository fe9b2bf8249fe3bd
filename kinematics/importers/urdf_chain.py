"""The chain of a robot description that becomes an arm."""

from collections.abc import Iterator, Mapping
from typing import NoReturn

import numpy as np

from traverse.kinematics.importers.urdf import Body, ChainJoint, moved_body
from traverse.kinematics.importers.urdf_file import Robot, UrdfJoint
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


def chain_of(robot: Robot, root: str | None, tip: str | None) -> list[ChainJoint]:
    """Walk from the root link to the tip link.

    Args:
        robot: As described.
        root: Where the arm stands; the only root if None.
        tip: What carries the probe; the only end if None.

    Raises:
        FileError: There is not one such chain, or it is no arm's; says what to choose.
    """
    path = _path(robot, root, tip)
    problems = [problem for joint in path for problem in _joint_problems(joint)]
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
        )
        for joint in path
    ]


def _path(robot: Robot, root: str | None, tip: str | None) -> list[UrdfJoint]:
    """Find the joints from the root to the tip, in that order."""
    for option, link in (("--root", root), ("--tip", tip)):
        if link is not None and link not in robot.links:
            _refuse(robot, option, unknown_name_message("link", link, robot.links))
    parents = {joint.parent for joint in robot.joint_of_child.values()}
    tips = [tip] if tip else [name for name in robot.links if name not in parents]
    found = {end: _way_up(robot, end, root) for end in tips}
    ways = {end: way for end, way in found.items() if way}
    if not ways:
        what = f"no chain of joints leads from {shown(root) if root else 'a root'} to "
        _refuse(robot, "", f"{what}{shown(tip) if tip else 'an end'}")
    if len(ways) > 1:
        # Ends that only fixed joints lead to are parts of the base.
        ways = {end: way for end, way in ways.items() if _turns(way)} or ways
    if len(ways) > 1:
        said = ", ".join(f"{end} ({_turns(way)} turning)" for end, way in ways.items())
        _refuse(robot, "", f"holds several chains; say --tip LINK, one of: {said}")
    return next(iter(ways.values()))


def _way_up(robot: Robot, tip: str, root: str | None) -> list[UrdfJoint] | None:
    """Walk from a tip to the root and turn the way round; None if it is not met."""
    way: list[UrdfJoint] = []
    passed: set[str] = set()
    link = tip
    while link != root and link in robot.joint_of_child:
        joint = robot.joint_of_child[link]
        if link in passed:
            what = f"joint {shown(joint.name)} is in a ring; an arm is an open chain"
            _refuse(robot, f"line {joint.line}", what)
        passed.add(link)
        way.append(joint)
        link = joint.parent
    return way[::-1] if root is None or link == root else None


def _turns(way: list[UrdfJoint]) -> int:
    return sum(joint.kind in _TURNING for joint in way)


def _joint_problems(joint: UrdfJoint) -> Iterator[Problem]:
    where = f"line {joint.line}"
    if joint.kind in _WHY_NOT:
        what = f"joint {shown(joint.name)} is {joint.kind}: {_WHY_NOT[joint.kind]}"
        yield Problem(where, f"{what}; make it fixed, or choose --root and --tip")
    if joint.mimics and joint.kind in _TURNING:
        what = f"joint {shown(joint.name)} mimics another; each hinge of an arm"
        yield Problem(where, f"{what} has an encoder of its own")


def _bodies(
    robot: Robot, link: str, fixed: Mapping[str, list[UrdfJoint]]
) -> Iterator[Body]:
    """Give what a link carries, with all that is fixed to it beside the chain."""
    pending = [(link, np.eye(4))]
    while pending:
        name, pose = pending.pop()
        body = robot.links[name]
        if body is not None:
            yield moved_body(pose, body)
        pending += [(j.child, pose @ j.origin) for j in fixed.get(name, ())]


def _refuse(robot: Robot, where: str, what: str) -> NoReturn:
    raise FileError(robot.source, [Problem(where, what)])
