"""Checks of an arm file between keys, on the raw values.

They run beside the checks of single keys, so that one reading reports everything;
therefore nothing here may trust a type. Wrong types are passed over, since they are
reported elsewhere.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.plurals import counted
from traverse.strict_toml.problems import (
    Problem,
    numbers_in,
    shown,
    tables_in,
    unknown_name_message,
    vector_in,
)

# Of the length of the vector: what hand-written decimals of a tilted axis leave over.
_PERPENDICULAR_TOLERANCE = 1e-6


def effect_problems(
    where: str, effect: Mapping[str, Any], axes: Mapping[str, Any]
) -> Iterator[Problem]:
    """Yield inconsistencies between the keys of one effect.

    Args:
        where: key path of the effect.
        effect: the raw table.
        axes: the raw axis of every joint by the joint's name.
    """
    name = effect.get("kind")
    if not isinstance(name, str):
        return
    kind = EFFECT_KINDS.get(name)
    if kind is None:
        return
    joint = effect.get("joint")
    if kind.joint == "absent" and "joint" in effect:
        yield Problem(f"{where}.joint", f"does not belong to {name}: remove it")
    elif isinstance(joint, str) and joint not in axes:
        yield Problem(
            f"{where}.joint",
            f"{shown(joint)} is not a joint of this arm; there are "
            f"{', '.join(axes) or 'none'}",
        )
    if kind.effect_class != "A" and "epoch_utc" in effect:
        yield Problem(f"{where}.epoch_utc", f"does not belong to {name}: remove it")
    order = None if isinstance(effect.get("order"), bool) else effect.get("order")
    least = kind.least_order(effect.get("component"))
    if kind.has_order and isinstance(order, int) and order < least:
        yield Problem(
            f"{where}.order",
            f"{order} is too small; {name} starts at order {least} "
            "(lower ones are part of the geometry or have their own kind)",
        )
    for key, most in kind.most.items():
        value = effect.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        if not 0.0 < value <= most:
            yield Problem(
                f"{where}.{key}", f"is {value:g}; expected above 0, up to {most:g}"
            )
    if "knots" in kind.keys:
        yield from _knot_problems(where, effect)
    axis = vector_in(axes.get(joint)) if isinstance(joint, str) else None
    if axis is not None and any(axis) and kind.is_about_axis:
        yield from _posture_problems(where, effect, kind.vectors, axis)


def _knot_problems(where: str, effect: Mapping[str, Any]) -> Iterator[Problem]:
    knots, values = numbers_in(effect.get("knots")), effect.get("values_rad")
    if knots is None:
        return
    if len(knots) < 2:
        yield Problem(
            f"{where}.knots", f"has {counted(len(knots), 'entry')}; 2 are needed"
        )
    elif any(after <= before for before, after in pairwise(knots)):
        yield Problem(f"{where}.knots", f"{shown(effect['knots'])} does not increase")
    if (
        isinstance(values, Sequence)
        and not isinstance(values, str)
        and len(values) != len(knots)
    ):
        yield Problem(
            f"{where}.values_rad",
            f"has {counted(len(values), 'entry')} for {counted(len(knots), 'knot')}; "
            "expected one each",
        )


def _posture_problems(
    where: str,
    effect: Mapping[str, Any],
    keys: tuple[str, ...],
    axis: tuple[float, ...],
) -> Iterator[Problem]:
    """Check vectors that must lie across or along the axis of the joint."""
    along = effect.get("component") == "axial"
    longest = max(map(abs, axis))
    u = [entry / longest for entry in axis]
    u = [entry / math.hypot(*u) for entry in u]
    for key in keys:
        vector = vector_in(effect.get(key))
        if vector is None or not any(vector):
            continue
        longest = max(map(abs, vector))
        v = [entry / longest for entry in vector]
        axial = sum(a * b for a, b in zip(u, v, strict=True))
        across = math.hypot(*(b - axial * a for a, b in zip(u, v, strict=True)))
        wrong = across if along else abs(axial)
        if wrong > _PERPENDICULAR_TOLERANCE * math.hypot(*v):
            expected = "along" if along else "orthogonal to"
            yield Problem(
                f"{where}.{key}",
                f"{shown(effect[key])} must be {expected} the axis of "
                f"{effect['joint']}, {shown(list(axis))}",
            )


_JOINT_NAME = re.compile(r"[A-Za-z0-9_-]+")


def is_joint_name(name: str) -> bool:
    return _JOINT_NAME.fullmatch(name) is not None


_SOURCE = re.compile(r"[^/\s]+/(0|[1-9][0-9]*)")
MAX_NAME_LENGTH = 64
_NOT_IN_TOPIC = re.compile(r"[/+#\x00-\x1f\x7f-\x9f]")


def arm_problems(raw: Mapping[str, Any]) -> Iterator[Problem]:
    """Yield inconsistencies between the keys of an arm file."""
    name = raw.get("name")
    if isinstance(name, str) and (
        not name.strip() or len(name) > MAX_NAME_LENGTH or _NOT_IN_TOPIC.search(name)
    ):
        yield Problem(
            "name",
            f"{shown(name)} cannot be a level of an MQTT topic; "
            f"use 1 to {MAX_NAME_LENGTH} letters, digits, '-' and '_', not / + #",
        )
    joints = tables_in(raw.get("joints"))
    if raw.get("joints") == []:
        yield Problem("joints", "is empty; an arm has at least one joint")
    names = [joint.get("name") for joint in joints]
    wrong = "is not a joint name; use letters, digits, '-' and '_'"
    yield from _text_problems("name", names, _JOINT_NAME, wrong, "names must differ")
    for index, joint in enumerate(joints):
        axis = vector_in(joint.get("axis"))
        if axis is not None and not any(axis):
            yield Problem(
                f"joints[{index}].axis",
                f"{shown(joint['axis'])} has no length; give the direction "
                "of the hinge",
            )
    yield from _coupling_problems(joints)
    encoders = [joint.get("encoder") for joint in joints]
    sources = [e.get("source") if isinstance(e, Mapping) else None for e in encoders]
    wrong = "is not '<device id>/<channel>', for example 'base/0'"
    remedy = "every joint needs its own channel"
    yield from _text_problems("encoder.source", sources, _SOURCE, wrong, remedy)
    yield from _direction_problems(joints, raw.get("probe"))
    axes = _by_name(joints, "axis")
    for index, effect in enumerate(tables_in(raw.get("effects"))):
        yield from effect_problems(f"effects[{index}]", effect, axes)


def _by_name(joints: Sequence[Mapping[str, Any]], key: str) -> dict[str, Any]:
    named = (joint for joint in joints if isinstance(joint.get("name"), str))
    return {joint["name"]: joint.get(key) for joint in named}


def _text_problems(
    key: str,
    texts: Sequence[object],
    pattern: re.Pattern[str],
    wrong: str,
    remedy: str,
) -> Iterator[Problem]:
    """Check texts of the joints that must fit a pattern and differ."""
    first: dict[str, int] = {}
    for index, text in enumerate(texts):
        if not isinstance(text, str):
            continue
        where = f"joints[{index}].{key}"
        if not pattern.fullmatch(text):
            yield Problem(where, f"{shown(text)} {wrong}")
        elif text in first:
            key_name = key.rpartition(".")[2]
            also = f"{shown(text)} is also the {key_name} of joints[{first[text]}]"
            yield Problem(where, f"{also}; {remedy}")
        first.setdefault(text, index)


def _coupling_problems(joints: Sequence[Mapping[str, Any]]) -> Iterator[Problem]:
    master_of = _by_name(joints, "coupled_to")
    for index, joint in enumerate(joints):
        where, master = f"joints[{index}].coupled_to", joint.get("coupled_to")
        if ("ratio" in joint) != ("coupled_to" in joint):
            key = "coupled_to" if "ratio" in joint else "ratio"
            yield Problem(f"joints[{index}]", f"{key} is missing; a coupling has both")
        if not isinstance(master, str):
            continue
        if master not in master_of:
            yield Problem(where, unknown_name_message("joint", master, master_of))
        way = [joint.get("name")]
        while isinstance(master, str) and master not in way:
            way.append(master)
            master = master_of.get(master)
        if master is not None and master == way[0]:
            ring = " to ".join(map(str, [*way, master]))
            yield Problem(where, f"couples {ring}: a ring; leave one of them out")


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
