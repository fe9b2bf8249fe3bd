"""Robot descriptions (URDF) as values.

Strict where the geometry is: an attribute of an origin, an axis or a mimic that is not
known here may move the arm, and is refused. Elements and attributes of other tools,
which have a prefix (`drake:`, `sensor:`), are ignored, but not xacro's, which stand for
elements that are still missing.

Safe against hostile XML: document types are refused, so no entity can be declared, let
alone expanded. Lengths leave here in millimetres.
"""

import re
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.importers.urdf import (
    Body,
    Mimic,
    moved_body,
    transform,
)
from traverse.kinematics.model.quaternion import rotation_matrix
from traverse.plurals import counted
from traverse.strict_toml.files import open_regular
from traverse.strict_toml.problems import (
    FileError,
    Problem,
    odd_characters,
    shown,
)

_LARGEST_BYTES = 2_000_000
_DEEPEST = 50
# In m, rad or kg: nothing of an arm is larger, and sums stay finite.
_LARGEST = 1e6
_TYPES = ("revolute", "continuous", "fixed", "prismatic", "floating", "planar")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
# Elements of a joint that place it, with all attributes that they may have.
_KNOWN = {
    "parent": ("link",),
    "child": ("link",),
    "origin": ("xyz", "rpy", "quat_xyzw"),
    "axis": ("xyz",),
    "mimic": ("joint", "multiplier", "offset"),
}
# Elements of a joint that do not place it.
_OTHER_PARTS = ("limit", "dynamics", "calibration", "safety_controller")
_EXPAND = "expand the file first: xacro FILE > robot.urdf"
# A quaternion is a rotation if its length is one within this.
_UNIT = 1e-3
_FULL_TURN_RAD = 2.0 * np.pi * (1.0 + 1e-3)


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
        links: Every link's body, if it has a mass.
        joint_of_child: The joint that carries each link but the root.
    """

    name: str
    source: str
    links: Mapping[str, Body | None]
    joint_of_child: Mapping[str, UrdfJoint]
    doubts: tuple[str, ...] = ()


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
        problem = f"cannot be read: {error.strerror or error}; check the path"
        raise FileError(source, problem) from error
    if len(content) > _LARGEST_BYTES:
        problem = f"is larger than {_LARGEST_BYTES} bytes; a robot description is not"
        raise FileError(source, problem)
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
        problem = (
            str(error) if isinstance(error, _RefusedError) else f"not XML: {error}"
        )
        raise FileError(source, [Problem(where, problem)]) from error
    return builder.close(), lines


class _Reading:
    """One reading of a description: collects errors while reading."""

    def __init__(self, source: str, lines: Mapping[Element, int]) -> None:
        self._source = source
        self._lines = lines
        self._problems: list[Problem] = []
        self._doubts: list[str] = []

    def robot(self, root: Element) -> Robot:
        if root.tag != "robot":
            self._refuse(root, f"the root is <{root.tag}>, expected <robot>")
        self._refuse_macros(root)
        self._doubt_attributes(root)
        links: dict[str, Body | None] = {}
        joints: dict[str, UrdfJoint] = {}
        names: set[str] = set()
        for element in root:
            name = element.get("name", "")
            if ":" in element.tag:
                if any(part.tag.split(":")[-1] == "parent" for part in element.iter()):
                    problem = "is a joint of another tool, which cannot be followed"
                    remedy = "write it as <joint>, or take it out"
                    self._refuse(element, f"<{element.tag}> {problem}; {remedy}")
                continue
            self._refuse_misspelt(element, ("link", "joint"))
            known = {"link": links, "joint": names}.get(element.tag, ())
            if element.tag in ("link", "joint") and (not name or name in known):
                problem = f"{element.tag} {shown(name)}: each needs its own name"
                self._refuse(element, problem)
            if element.tag == "link":
                links[name] = self._body(element)
            elif element.tag == "joint":
                names.add(name)
                joint = self._joint(element, name)
                if joint.child in joints:
                    first_joint = joints[joint.child].name
                    problem = (
                        f"joints {shown(first_joint)} and {shown(name)} both carry "
                    )
                    self._refuse(element, f"{problem}{shown(joint.child)}")
                joints[joint.child] = joint
        self._refuse_missing_links(joints.values(), links)
        if self._problems:
            raise FileError(self._source, self._problems)
        name = root.get("name", "")
        return Robot(name, self._source, links, joints, tuple(self._doubts))

    def _doubt_attributes(self, root: Element) -> None:
        for key, value in root.attrib.items():
            if key not in ("name", "version") and not key.startswith("xmlns"):
                problem = f"{key} = {shown(value)} of <robot> is not known here"
                self._doubts.append(f"{problem} and was ignored: a unit or a scale?")

    def _refuse_missing_links(
        self, joints: Iterable[UrdfJoint], links: Container[str]
    ) -> None:
        for joint in joints:
            for link in (joint.parent, joint.child):
                if link not in links:
                    problem = (
                        f"joint {shown(joint.name)}: there is no link {shown(link)}"
                    )
                    self._problems.append(Problem(f"line {joint.line}", problem))

    def _refuse_macros(self, root: Element) -> None:
        """Refuse elements of xacro, whatever its prefix, and its expressions."""
        prefixes = {
            key.removeprefix("xmlns:")
            for key, value in root.attrib.items()
            if key.startswith("xmlns:") and "xacro" in value
        } | {"xacro"}
        for element in root.iter():
            prefix, colon, _ = element.tag.partition(":")
            if colon and prefix in prefixes:
                self._refuse(element, f"<{element.tag}> is a macro; {_EXPAND}")
            if element.tag not in ("link", "joint", *_KNOWN):
                continue
            for key, value in element.attrib.items():
                if "${" in value or "$(" in value:
                    problem = f"<{element.tag}> {key} = {shown(value)} is an expression"
                    self._refuse(element, f"{problem} of xacro; {_EXPAND}")

    def _joint(self, element: Element, name: str) -> UrdfJoint:
        kind = element.get("type", "")
        if kind not in _TYPES:
            known = ", ".join(_TYPES)
            self._refuse(element, f"joint {shown(name)}: type {shown(kind)}; {known}")
        for part in element:
            if part.tag in _KNOWN:
                self._check_attributes(part)
            elif ":" not in part.tag and part.tag not in _OTHER_PARTS:
                self._refuse_misspelt(part, _KNOWN)
                where = f"line {self._lines[part]}: <{part.tag}>"
                self._doubts.append(
                    f"{where} of joint {shown(name)} is not known here and was "
                    "ignored: does it move the joint?"
                )
        for tag in _KNOWN:
            if len(element.findall(tag)) > 1:
                problem = f"joint {shown(name)}: has several <{tag}>; expected one"
                self._refuse(element, problem)
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

    def _check_attributes(self, element: Element) -> None:
        known = _KNOWN[element.tag]
        for key in element.attrib:
            if key not in known and ":" not in key and key != "xmlns":
                expected = " and ".join(known)
                self._refuse(
                    element,
                    f"<{element.tag}> has the attribute {shown(key)}, which is not "
                    f"known here and may move the arm; expected {expected}; write it "
                    "in these, or take it out",
                )

    def _refuse_misspelt(self, element: Element, known: Iterable[str]) -> None:
        """Refuse an element whose capitals alone keep it from being read."""
        tag = element.tag.lower()
        if tag != element.tag and tag in known:
            self._refuse(element, f"<{element.tag}> is not known; write <{tag}>")

    def _mimic(self, element: Element | None) -> Mimic | None:
        if element is None:
            return None
        (ratio,) = self._numbers(element, "multiplier", (1.0,))
        (offset_rad,) = self._numbers(element, "offset", (0.0,))
        return Mimic(element.get("joint", ""), ratio, offset_rad)

    def _link_name(self, element: Element, tag: str) -> str:
        link = element.find(tag)
        name = "" if link is None else link.get("link", "")
        if not name:
            joint = shown(element.get("name", ""))
            self._refuse(element, f'joint {joint}: has no <{tag} link="...">')
        return name

    def _body(self, link: Element) -> Body | None:
        inertial = link.find("inertial")
        mass = None if inertial is None else inertial.find("mass")
        if inertial is None or mass is None:
            return None
        (mass_kg,) = self._numbers(mass, "value", (0.0,))
        if mass_kg < 0.0:
            self._refuse(mass, f"mass {mass_kg} is negative")
        if (origin := inertial.find("origin")) is not None:
            self._check_attributes(origin)
        return moved_body(self._origin(inertial), Body(mass_kg, np.zeros(3)))

    def _origin(self, element: Element) -> Floats:
        origin = element.find("origin")
        zeros = (0.0, 0.0, 0.0)
        xyz_m = self._numbers(origin, "xyz", zeros)
        placed = transform([1000.0 * length for length in xyz_m], zeros)
        if origin is None:
            return placed
        if "quat_xyzw" in origin.attrib:
            if "rpy" in origin.attrib:
                self._refuse(origin, "<origin> has rpy and quat_xyzw; expected one")
            placed[:3, :3] = self._rotation(origin)
            return placed
        rpy_rad = self._numbers(origin, "rpy", zeros)
        if max(map(abs, rpy_rad)) > _FULL_TURN_RAD:
            where = f"line {self._lines[origin]}: rpy = {shown(origin.get('rpy'))}"
            self._doubts.append(f"{where} is more than a turn in radians: degrees?")
        placed[:3, :3] = transform(zeros, rpy_rad)[:3, :3]
        return placed

    def _rotation(self, origin: Element) -> Floats:
        """Read a unit quaternion x, y, z, w as a rotation, (3, 3)."""
        x, y, z, w = self._numbers(origin, "quat_xyzw", (0.0, 0.0, 0.0, 1.0))
        length = float(np.linalg.norm([x, y, z, w]))
        if abs(length - 1.0) > _UNIT:
            problem = f"<origin> quat_xyzw has the length {length:.6g}; expected 1"
            self._refuse(origin, problem)
            return np.eye(3)
        return rotation_matrix(np.array([w, x, y, z]) / length)

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
            problem = f"<{element.tag}> {key} = {shown(text)}: expected {expected}"
            if odd := odd_characters(" ".join(words)):
                problem += f"; it has {odd}"
            self._refuse(element, problem)
            return default
        return numbers

    def _refuse(self, element: Element, problem: str) -> None:
        self._problems.append(Problem(f"line {self._lines[element]}", problem))
