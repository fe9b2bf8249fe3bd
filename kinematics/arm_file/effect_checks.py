"""Checks of one entry of `[[effects]]`, on the raw values.

The rules of `arm_checks` hold here too: trust no type, keep silent on wrong ones.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from traverse.kinematics.effect_table import EFFECT_KINDS, EffectKind
from traverse.strict_toml.problems import Problem, shown
from traverse.strict_toml.raw_values import numbers_in, vector_in

# Of the length of the vector: what hand-written decimals of a tilted axis leave over.
_PERPENDICULAR_TOLERANCE = 1e-6


def effect_problems(
    where: str, effect: Mapping[str, Any], axes: Mapping[str, Any]
) -> Iterator[Problem]:
    """Yield what is wrong between the keys of one effect.

    Args:
        where: Key path of the effect.
        effect: The raw table.
        axes: The raw axis of every joint by the joint's name.
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
    yield from _order_problems(where, effect, kind)
    yield from _range_problems(where, effect, kind)
    if "knots" in kind.keys:
        yield from _knot_problems(where, effect)
    axis = vector_in(axes.get(joint)) if isinstance(joint, str) else None
    if axis is not None and any(axis) and kind.is_about_axis:
        yield from _posture_problems(where, effect, kind.vectors, axis)


def _order_problems(
    where: str, effect: Mapping[str, Any], kind: EffectKind
) -> Iterator[Problem]:
    order = effect.get("order")
    if "order" not in kind.keys or isinstance(order, bool):
        return
    least = kind.least_order(effect.get("component"))
    if isinstance(order, int) and order < least:
        yield Problem(
            f"{where}.order",
            f"{order} is too small; {effect['kind']} starts at order {least} "
            "(lower ones are part of the geometry or have their own kind)",
        )


def _range_problems(
    where: str, effect: Mapping[str, Any], kind: EffectKind
) -> Iterator[Problem]:
    for key, most in kind.most.items():
        value = effect.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        if not 0.0 < value <= most:
            yield Problem(
                f"{where}.{key}", f"is {value:g}; expected above 0, up to {most:g}"
            )


def _knot_problems(where: str, effect: Mapping[str, Any]) -> Iterator[Problem]:
    knots, values = numbers_in(effect.get("knots")), effect.get("values_rad")
    if knots is None:
        return
    if len(knots) < 2:
        yield Problem(f"{where}.knots", f"has {len(knots)} entries; 2 are needed")
    elif any(after <= before for before, after in pairwise(knots)):
        yield Problem(f"{where}.knots", f"{shown(effect['knots'])} does not increase")
    if (
        isinstance(values, Sequence)
        and not isinstance(values, str)
        and len(values) != len(knots)
    ):
        yield Problem(
            f"{where}.values_rad",
            f"has {len(values)} entries for {len(knots)} knots; one each is needed",
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
