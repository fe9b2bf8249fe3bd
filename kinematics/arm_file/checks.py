"""Checks of an arm file that look at more than one key, on the raw values.

They run beside the checks of single keys, not after them, so that one reading of a
file reports everything; therefore nothing here may trust a type. Each check keeps
silent where the type is wrong, because that is reported elsewhere.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from traverse.kinematics.arm_file.effect_checks import effect_problems
from traverse.strict_toml.problems import Problem, shown
from traverse.strict_toml.raw_values import tables_in, vector_in

_JOINT_NAME = re.compile(r"[A-Za-z0-9_-]+")
_SOURCE = re.compile(r"[^/\s]+/(0|[1-9][0-9]*)")
MAX_NAME_LENGTH = 64
_NOT_IN_TOPIC = re.compile(r"[/+#\x00-\x1f\x7f-\x9f]")


def arm_problems(raw: Mapping[str, Any]) -> Iterator[Problem]:
    """Yield what is wrong between the keys of an arm file."""
    yield from _name_problems(raw.get("name"))
    joints = tables_in(raw.get("joints"))
    if raw.get("joints") == []:
        yield Problem("joints", "is empty; an arm has at least one joint")
    yield from _joint_problems(joints)
    yield from _source_problems(joints)
    yield from _direction_problems(joints, raw.get("probe"))
    axes = {
        joint["name"]: joint.get("axis")
        for joint in joints
        if isinstance(joint.get("name"), str)
    }
    for index, effect in enumerate(tables_in(raw.get("effects"))):
        yield from effect_problems(f"effects[{index}]", effect, axes)


def _name_problems(name: object) -> Iterator[Problem]:
    if not isinstance(name, str):
        return
    is_long = len(name) > MAX_NAME_LENGTH
    if not name.strip() or is_long or _NOT_IN_TOPIC.search(name):
        yield Problem(
            "name",
            f"{shown(name)} cannot be a level of an MQTT topic; "
            f"use 1 to {MAX_NAME_LENGTH} letters, digits, '-' and '_', not / + #",
        )


def _joint_problems(joints: Sequence[Mapping[str, Any]]) -> Iterator[Problem]:
    first_of_name: dict[str, int] = {}
    for index, joint in enumerate(joints):
        name = joint.get("name")
        if isinstance(name, str):
            where = f"joints[{index}].name"
            if not _JOINT_NAME.fullmatch(name):
                yield Problem(
                    where,
                    f"{shown(name)} is not a joint name; use letters, digits, "
                    "'-' and '_'",
                )
            elif name in first_of_name:
                yield Problem(
                    where,
                    f"{shown(name)} is also the name of joints"
                    f"[{first_of_name[name]}]; names must differ",
                )
            first_of_name.setdefault(name, index)
        axis = vector_in(joint.get("axis"))
        if axis is not None and not any(axis):
            yield Problem(
                f"joints[{index}].axis",
                f"{shown(joint['axis'])} has no length; give the direction "
                "of the hinge",
            )


def _source_problems(joints: Sequence[Mapping[str, Any]]) -> Iterator[Problem]:
    first_of_source: dict[str, int] = {}
    for index, joint in enumerate(joints):
        encoder = joint.get("encoder")
        if not isinstance(encoder, Mapping):
            continue
        source = encoder.get("source")
        if not isinstance(source, str):
            continue
        where = f"joints[{index}].encoder.source"
        if not _SOURCE.fullmatch(source):
            yield Problem(
                where,
                f"{shown(source)} is not '<device id>/<channel>', for example 'base/0'",
            )
        elif source in first_of_source:
            yield Problem(
                where,
                f"{shown(source)} is also the source of joints"
                f"[{first_of_source[source]}]; every joint needs its own channel",
            )
        first_of_source.setdefault(source, index)


def _direction_problems(
    joints: Sequence[Mapping[str, Any]], probe: object
) -> Iterator[Problem]:
    if not isinstance(probe, Mapping):
        return
    if "direction" in probe:
        direction = vector_in(probe["direction"])
        if direction is not None and not any(direction):
            yield Problem(
                "probe.direction",
                f"{shown(probe['direction'])} has no length; give the unit vector "
                "along the shank towards the ball",
            )
        return
    link = vector_in(joints[-1].get("link_mm")) if joints else None
    vector = vector_in(probe.get("vector_mm", (0.0, 0.0, 0.0)))
    if link is None or vector is None:
        return
    if not any(a + b for a, b in zip(link, vector, strict=True)):
        yield Problem(
            "probe.direction",
            "is missing, and cannot be taken along the last link plus vector_mm, "
            "whose sum is zero; add the direction of the shank",
        )
