"""Robot descriptions (URDF) as values: strict, and safe against hostile XML.

Document types are refused, so no entity can be declared, let alone expanded. Lengths
leave here in millimetres.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.importers.urdf import Body, moved_body, transform
from traverse.strict_toml.problems import FileError, Problem, shown

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
    mimics: bool
    line: int


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """A robot as described.

    Attributes:
        name: Of the robot.
        source: The file, for errors.
        links: Every link's body, if it has a mass.
        joint_of_child: What carries each link but the root.
    """

    name: str
    source: str
    links: Mapping[str, Body | None]
    joint_of_child: Mapping[str, UrdfJoint]


class _RefusedError(ValueError):
    """What the file may not hold, met while it is read."""


def read_urdf(path: Path) -> Robot:
    """Read a robot description.

    Raises:
        FileError: With everything that is wrong, by line.
    """
    source = str(path)
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST_BYTES + 1)
    except OSError as error:
        what = f"cannot be read: {error.strerror or error}; check the path"
        raise FileError(source, [Problem("", what)]) from error
    if len(content) > _LARGEST_BYTES:
        what = f"is larger than {_LARGEST_BYTES} bytes; a robot description is not"
        raise FileError(source, [Problem("", what)])
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
    """One reading of a description: gathers what is wrong as it goes."""

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
            elif element.tag == "link":
                if not name or name in links:
                    self._refuse(
                        element, f"link {shown(name)}: each needs its own name"
                    )
                links[name] = self._body(element)
            elif element.tag == "joint":
                if not name or name in names:
                    self._refuse(
                        element, f"joint {shown(name)}: each needs its own name"
                    )
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
            mimics=element.find("mimic") is not None,
            line=self._lines[element],
        )

    def _link_name(self, element: Element, which: str) -> str:
        found = element.find(which)
        name = "" if found is None else found.get("link", "")
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
            expected = (
                f"{len(default)} number{'s' if len(default) > 1 else ''} below 1e6"
            )
            what = f"<{element.tag}> {key} = {shown(text)}: expected {expected}"
            self._refuse(element, what)
            return default
        return numbers

    def _refuse(self, element: Element, what: str) -> None:
        self._problems.append(Problem(f"line {self._lines[element]}", what))
