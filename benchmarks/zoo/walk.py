"""Forward kinematics of a robot description, written for this benchmark alone.

Shares nothing with Traverse: `xml.etree`, four-by-four matrices in metres, Rodrigues'
formula. It reports elements that it does not understand.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
_PREFIX = re.compile(r"(<[/]?[A-Za-z_]\w*|\s[A-Za-z_]\w*):(?=[A-Za-z_][\w.-]*[\s=/>])")
TURNING = ("revolute", "continuous")


@dataclass(frozen=True)
class Joint:
    """A joint; `mimic` is the other joint, multiplier and offset."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Matrix
    axis: Matrix
    mimic: tuple[str, float, float] | None


@dataclass(frozen=True)
class Description:
    """Joints by their child link, and all links."""

    joints: Mapping[str, Joint]
    links: tuple[str, ...]

    def ends(self) -> Iterator[str]:
        parents = {joint.parent for joint in self.joints.values()}
        yield from (link for link in self.links if link not in parents)

    def chain(self, tip: str) -> list[Joint]:
        joints: list[Joint] = []
        while tip in self.joints and len(joints) <= len(self.joints):
            joints.append(self.joints[tip])
            tip = joints[-1].parent
        return joints[::-1]


def read(path: Path) -> Description:
    """Read a description.

    Raises:
        ValueError: It is not understood here.
    """
    try:
        # Prefixes of other tools are often declared nowhere.
        text = _PREFIX.sub(r"\1_", path.read_text("utf-8"))
        root = ElementTree.fromstring(text.encode())
    except ElementTree.ParseError as error:
        raise ValueError(f"not XML: {error}") from error
    joints = [_joint(element) for element in root.findall("joint")]
    links = [element.get("name", "") for element in root.findall("link")]
    children = [joint.child for joint in joints]
    if len(set(children)) < len(children) or len(set(links)) < len(links):
        raise ValueError("a link is carried, or named, twice")
    if len({joint.name for joint in joints}) < len(joints):
        raise ValueError("two joints have one name")
    if {*children, *(joint.parent for joint in joints)} - {*links}:
        raise ValueError("a joint names a link that is not there")
    return Description({joint.child: joint for joint in joints}, tuple(links))


def _joint(element: ElementTree.Element) -> Joint:
    def link(tag: str) -> str:
        child = element.find(tag)
        if child is None:
            raise ValueError(f"joint {element.get('name')} has no <{tag}>")
        return child.get("link", "")

    def numbers(of: ElementTree.Element | None, key: str, default: str) -> Matrix:
        return np.array([float(word) for word in _get(of, key, default).split()])

    origin, mimic = element.find("origin"), element.find("mimic")
    pose = np.eye(4)
    pose[:3, 3] = numbers(origin, "xyz", "0 0 0")
    roll, pitch, yaw = numbers(origin, "rpy", "0 0 0")
    for axis, angle in (("z", yaw), ("y", pitch), ("x", roll)):
        pose = pose @ turned(np.eye(3)["xyz".index(axis)], angle)
    follows = None
    if mimic is not None:
        ratio, offset = _get(mimic, "multiplier", "1"), _get(mimic, "offset", "0")
        follows = (mimic.get("joint", ""), float(ratio), float(offset))
    return Joint(
        element.get("name", ""),
        element.get("type", ""),
        link("parent"),
        link("child"),
        pose,
        numbers(element.find("axis"), "xyz", "1 0 0"),
        follows,
    )


def _get(element: ElementTree.Element | None, key: str, default: str) -> str:
    return default if element is None else element.get(key, default)


def turned(axis: Matrix, angle: float) -> Matrix:
    """Make the turn about an axis by Rodrigues' formula, (4, 4)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose = np.eye(4)
    pose[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return pose


def value_of(
    name: str, joints: Mapping[str, Joint], values: Mapping[str, float]
) -> float:
    """Return the value of a joint, through those that it mimics."""
    for _ in range(len(joints) + 1):
        if name in values:
            return values[name]
        mimic = joints[name].mimic if name in joints else None
        if mimic is None:
            raise ValueError(f"joint {name} has no value")
        master, ratio, offset = mimic
        if master in values:
            return ratio * values[master] + offset
        inner = joints[master].mimic if master in joints else None
        if inner is None:
            raise ValueError(f"joint {master} has no value")
        return ratio * value_of(master, joints, values) + offset
    raise ValueError(f"joint {name} mimics in a ring")


def place_mm(
    chain: list[Joint], values: Mapping[str, float], every: Description
) -> Matrix:
    """Return where the end of a chain is, (3,), at the values of its joints."""
    by_name = {joint.name: joint for joint in every.joints.values()}
    pose = np.eye(4)
    for joint in chain:
        pose = pose @ joint.origin
        if joint.kind in TURNING:
            pose = pose @ turned(joint.axis, value_of(joint.name, by_name, values))
        elif joint.kind == "prismatic":
            shift = np.eye(4)
            shift[:3, 3] = joint.axis / np.linalg.norm(joint.axis)
            shift[:3, 3] *= value_of(joint.name, by_name, values)
            pose = pose @ shift
    place: Matrix = 1000.0 * pose[:3, 3]
    return place
