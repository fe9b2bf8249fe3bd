"""Robot descriptions (URDF) as values, and the chain of one that becomes an arm.

Strict, and safe against hostile XML: document types are refused, so no entity can be
declared, let alone expanded. Lengths leave here in millimetres.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.importers.urdf import (
    Body,
    ChainJoint,
    Mimic,
    moved_body,
    transform,
)
from traverse.plurals import counted
from traverse.strict_toml.files import open_regular
from traverse.strict_toml.problems import (
    FileError,
    Problem,
    shown,
    unknown_name_message,
)

_LARGEST_BYTES = 2_000_000
_DEEPEST = 50
# In m, rad or kg: nothing of an arm is larger, and sums stay finite.
_LARGEST = 1e6
_TYPES = ("revolute", "continuous", "fixed", "prismatic", "floating", "planar")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True, slots=True, eq=False)
class UrdfJoint:
    """A joint as described; `origin` from the child's frame to the parent's, mm."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Floats
    axis: Floats
    mimic: Mimic | None
    line: int


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """A robot as described.

    Attributes:
        source: The file, for errors.
        links: Every link's body, if it has a mass.
        joint_of_child: What carries each link but the root.
    """

    name: str
    source: str
    links: Mapping[str, Body | None]
    joint_of_child: Mapping[str, UrdfJoint]


class _RefusedError(ValueError):
    """Forbidden content of the file, found while reading."""


def read_urdf(path: Path) -> Robot:
    """Read a robot description.

    Raises:
        FileError: With everything that is wrong, by line.
    """
    source = str(path)
    try:
        with open_regular(path) as file:
            content = file.read(_LARGEST_BYTES + 1)
    except OSError as error:
        what = f"cannot be read: {error.strerror or error}; check the path"
        raise FileError(source, what) from error
    if len(content) > _LARGEST_BYTES:
        what = f"is larger than {_LARGEST_BYTES} bytes; a robot description is not"
        raise FileError(source, what)
    root, lines = _elements(content, source)
    return _Reading(source, lines).robot(root)


def _elements(content: bytes, source: str) -> tuple[Element, dict[Element, int]]:
    """Parse XML: the root, and every element's line."""
    builder, lines, depth = TreeBuilder(), dict[Element, int](), 0
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise _RefusedError(f"elements stand more than {_DEEPEST} deep")
        lines[builder.start(tag, attributes)] = parser.CurrentLineNumber

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise _RefusedError(
            "has a document type; a robot description needs none, drop it"
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, _RefusedError, ValueError, LookupError) as error:
        where = f"line {parser.CurrentLineNumber}"
        what = str(error) if isinstance(error, _RefusedError) else f"not XML: {error}"
        raise FileError(source, [Problem(where, what)]) from error
    return builder.close(), lines


class _Reading:
    """One reading of a description: collects errors while reading."""

    def __init__(self, source: str, lines: Mapping[Element, int]) -> None:
        self._source = source
        self._lines = lines
        self._problems: list[Problem] = []

    def robot(self, root: Element) -> Robot:
        if root.tag != "robot":
            self._refuse(root, f"the root is <{root.tag}>, expected <robot>")
        links: dict[str, Body | None] = {}
        joints: dict[str, UrdfJoint] = {}
        names: set[str] = set()
        for element in root:
            name = element.get("name", "")
            if ":" in element.tag:
                what = "is a macro; expand the file first: xacro FILE > robot.urdf"
                self._refuse(element, f"<{element.tag}> {what}")
                continue
            taken = {"link": links, "joint": names}.get(element.tag, ())
            if element.tag in ("link", "joint") and (not name or name in taken):
                what = f"{element.tag} {shown(name)}: each needs its own name"
                self._refuse(element, what)
            if element.tag == "link":
                links[name] = self._body(element)
            elif element.tag == "joint":
                names.add(name)
                joint = self._joint(element, name)
                if joint.child in joints:
                    other = joints[joint.child].name
                    what = f"joints {shown(other)} and {shown(name)} both carry "
                    self._refuse(element, f"{what}{shown(joint.child)}")
                joints[joint.child] = joint
        for joint in joints.values():
            for link in (joint.parent, joint.child):
                if link not in links:
                    what = f"joint {shown(joint.name)}: there is no link {shown(link)}"
                    self._problems.append(Problem(f"line {joint.line}", what))
        if self._problems:
            raise FileError(self._source, self._problems)
        return Robot(root.get("name", ""), self._source, links, joints)

    def _joint(self, element: Element, name: str) -> UrdfJoint:
        kind = element.get("type", "")
        if kind not in _TYPES:
            known = ", ".join(_TYPES)
            self._refuse(element, f"joint {shown(name)}: type {shown(kind)}; {known}")
        axis_element = element.find("axis")
        axis = self._numbers(axis_element, "xyz", (1.0, 0.0, 0.0))
        if axis_element is not None and kind in _TYPES[:2] and not any(axis):
            self._refuse(axis_element, f"joint {shown(name)}: the axis has no length")
        return UrdfJoint(
            name=name,
            kind=kind,
            parent=self._link_name(element, "parent"),
            child=self._link_name(element, "child"),
            origin=self._origin(element),
            axis=np.array(axis),
            mimic=self._mimic(element.find("mimic")),
            line=self._lines[element],
        )

    def _mimic(self, element: Element | None) -> Mimic | None:
        if element is None:
            return None
        (ratio,) = self._numbers(element, "multiplier", (1.0,))
        (offset_rad,) = self._numbers(element, "offset", (0.0,))
        return Mimic(element.get("joint", ""), ratio, offset_rad)

    def _link_name(self, element: Element, which: str) -> str:
        link = element.find(which)
        name = "" if link is None else link.get("link", "")
        if not name:
            joint = shown(element.get("name", ""))
            self._refuse(element, f'joint {joint}: has no <{which} link="...">')
        return name

    def _body(self, link: Element) -> Body | None:
        inertial = link.find("inertial")
        mass = None if inertial is None else inertial.find("mass")
        if inertial is None or mass is None:
            return None
        (mass_kg,) = self._numbers(mass, "value", (0.0,))
        if mass_kg < 0.0:
            self._refuse(mass, f"mass {mass_kg} is negative")
        return moved_body(self._origin(inertial), Body(mass_kg, np.zeros(3)))

    def _origin(self, element: Element) -> Floats:
        origin = element.find("origin")
        zeros = (0.0, 0.0, 0.0)
        xyz_m = self._numbers(origin, "xyz", zeros)
        rpy_rad = self._numbers(origin, "rpy", zeros)
        return transform([1000.0 * length for length in xyz_m], rpy_rad)

    def _numbers(
        self, element: Element | None, key: str, default: Sequence[float]
    ) -> Sequence[float]:
        text = None if element is None else element.get(key)
        if element is None or text is None:
            return default
        words = text.split()
        numbers = [float(word) for word in words if _NUMBER.fullmatch(word)]
        good = len(words) == len(numbers) == len(default)
        if not good or not all(abs(number) < _LARGEST for number in numbers):
            expected = f"{counted(len(default), 'number')} below 1e6"
            what = f"<{element.tag}> {key} = {shown(text)}: expected {expected}"
            self._refuse(element, what)
            return default
        return numbers

    def _refuse(self, element: Element, what: str) -> None:
        self._problems.append(Problem(f"line {self._lines[element]}", what))


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
        root: Link of the arm's base; the only root if None.
        tip: What carries the probe; the only end if None.

    Raises:
        FileError: There is not one such chain, or it is no arm's; says what to choose.
    """
    path = _path(robot, root, tip)
    free = [j.name for j in path if j.kind in _TURNING and j.mimic is None]
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
            mimic=joint.mimic,
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
    ways_up = {end: _way_up(robot, end, root) for end in tips}
    ways = {end: way for end, way in ways_up.items() if way}
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


def _joint_problems(joint: UrdfJoint, free: Sequence[str]) -> Iterator[Problem]:
    where = f"line {joint.line}"
    if joint.kind in _WHY_NOT:
        what = f"joint {shown(joint.name)} is {joint.kind}: {_WHY_NOT[joint.kind]}"
        yield Problem(where, f"{what}; make it fixed, or choose --root and --tip")
    mimic = joint.mimic if joint.kind in _TURNING else None
    if mimic is not None and mimic.joint not in free:
        what = (
            f"joint {shown(joint.name)} mimics {shown(mimic.joint)}; expected a joint"
        )
        yield Problem(where, f"{what} that turns freely: {', '.join(free) or 'none'}")


def _bodies(
    robot: Robot, link: str, fixed: Mapping[str, list[UrdfJoint]]
) -> Iterator[Body]:
    """Return what a link carries, with all that is fixed to it beside the chain."""
    pending = [(link, np.eye(4))]
    while pending:
        name, pose = pending.pop()
        body = robot.links[name]
        if body is not None:
            yield moved_body(pose, body)
        pending += [(j.child, pose @ j.origin) for j in fixed.get(name, ())]


def _refuse(robot: Robot, where: str, what: str) -> NoReturn:
    raise FileError(robot.source, [Problem(where, what)])
