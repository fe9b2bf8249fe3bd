"""Elements made of elements: intersections, projections, symmetry points.

Each is a function of the values q of its elements; its derivatives are exact to
rounding by a complex step, df/dx = Im f(x + i h) / h, and lead on to the touches:
W = df/dq_1 W_1 + df/dq_2 W_2.
"""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Floats
from traverse.kinematics.fits.elements import (
    ANGLE,
    DIRECTION,
    N_VALUES,
    PLACE,
    RADIUS,
    Element,
    Kind,
)

Shape = Literal["point", "line", "plane"]
Relation = Literal["intersection", "projection", "symmetry", "apex"]
Numbers = NDArray[Any]  # real, or complex with a step
_STEP = 1e-30
_PARALLEL = 1e-3  # sine of the angle between what should intersect
SHAPES: dict[Kind, Shape] = {
    "point": "point",
    "circle": "point",
    "sphere": "point",
    "line": "line",
    "cylinder": "line",
    "cone": "line",
    "plane": "plane",
}
"""What an element is in relations: its centre, its axis, or itself."""


def derivatives(
    function: Callable[..., Numbers], *values: Floats
) -> tuple[Floats, list[Floats]]:
    """Return values of a function, (m,), and derivatives by each argument, (m, k)."""
    result = np.real(function(*values))
    columns: list[Floats] = []
    for place, value in enumerate(values):
        steps = value + 1j * _STEP * np.eye(len(value))
        moved = [
            np.imag(function(*values[:place], step, *values[place + 1 :])) / _STEP
            for step in steps
        ]
        columns.append(np.stack(moved, axis=-1))
    return result, columns


def related(relation: Relation, *elements: Element) -> Element:
    """Make an element of others.

    Raises:
        ValueError: there is no such element.
    """
    relation_row, ordered = None, elements
    for ordered in (elements, elements[::-1]):
        shapes = tuple(SHAPES[element.kind] for element in ordered)
        relation_row = _RELATIONS.get((relation, shapes))
        if relation_row is not None:
            break
    is_apex_of_other = relation == "apex" and elements[0].kind != "cone"
    if relation_row is None or is_apex_of_other:
        words = " and ".join(element.kind for element in elements)
        raise ValueError(f"there is no {relation} of {words}")
    kind, function = relation_row
    if relation == "intersection":
        _refuse_parallel(ordered)
    values, by_values = derivatives(function, *(e.values for e in ordered))
    by_points = sum(
        np.einsum("qp,pni->qni", by_element, element.by_points)
        for by_element, element in zip(by_values, ordered, strict=True)
    )
    return Element(kind, values, np.asarray(by_points))


def _refuse_parallel(elements: tuple[Element, ...]) -> None:
    first, second = (element.direction for element in elements)
    sine = float(np.linalg.norm(np.cross(first, second)))
    if {SHAPES[element.kind] for element in elements} == {"line", "plane"}:
        sine = abs(float(first @ second))
    if sine < _PARALLEL:
        raise ValueError("they are parallel, and do not intersect")


# -- functions of values: no absolute value, no conjugate ------------------------------


def _located(place: Numbers, direction: Numbers | None = None) -> Numbers:
    values = np.zeros(N_VALUES, dtype=place.dtype)
    values[PLACE] = place
    if direction is not None:
        values[DIRECTION] = direction
    return values


def _unit(vector: Numbers) -> Numbers:
    unit: Numbers = vector / np.sqrt(vector @ vector)
    return unit


def _apex(cone: Numbers) -> Numbers:
    return _located(cone[PLACE] - cone[RADIUS] / np.tan(cone[ANGLE]) * cone[DIRECTION])


def _middle(first: Numbers, second: Numbers) -> Numbers:
    return _located((first[PLACE] + second[PLACE]) / 2.0)


def _onto_plane(point: Numbers, plane: Numbers) -> Numbers:
    off = plane[DIRECTION] @ (point[PLACE] - plane[PLACE])
    return _located(point[PLACE] - off * plane[DIRECTION])


def _onto_line(point: Numbers, line: Numbers) -> Numbers:
    along = line[DIRECTION] @ (point[PLACE] - line[PLACE])
    return _located(line[PLACE] + along * line[DIRECTION])


def _line_through_plane(line: Numbers, plane: Numbers) -> Numbers:
    normal, direction = plane[DIRECTION], line[DIRECTION]
    along = normal @ (plane[PLACE] - line[PLACE]) / (normal @ direction)
    return _located(line[PLACE] + along * direction)


def _planes_line(first: Numbers, second: Numbers) -> Numbers:
    direction = _unit(np.cross(first[DIRECTION], second[DIRECTION]))
    normals = np.stack([first[DIRECTION], second[DIRECTION], direction])
    middle = (first[PLACE] + second[PLACE]) / 2.0
    levels = np.stack(
        [
            first[DIRECTION] @ first[PLACE],
            second[DIRECTION] @ second[PLACE],
            direction @ middle,
        ]
    )
    return _located(np.linalg.solve(normals, levels), direction)


def _lines_point(first: Numbers, second: Numbers) -> Numbers:
    """Return the middle of the shortest way between two lines."""
    across = np.cross(first[DIRECTION], second[DIRECTION])
    ways = np.stack([first[DIRECTION], -second[DIRECTION], across], axis=1)
    along = np.linalg.solve(ways, second[PLACE] - first[PLACE])
    on_first = first[PLACE] + along[0] * first[DIRECTION]
    return _located(on_first + along[2] * across / 2.0)


_RELATIONS: dict[tuple[str, tuple[Shape, ...]], tuple[Kind, Callable[..., Numbers]]] = {
    ("intersection", ("line", "plane")): ("point", _line_through_plane),
    ("intersection", ("plane", "plane")): ("line", _planes_line),
    ("intersection", ("line", "line")): ("point", _lines_point),
    ("projection", ("point", "plane")): ("point", _onto_plane),
    ("projection", ("point", "line")): ("point", _onto_line),
    ("symmetry", ("point", "point")): ("point", _middle),
    ("apex", ("line",)): ("point", _apex),
}
