"""Circles and edges: elements fitted in a plane, into which points are projected.

The plane's errors dp belong to the result: dq = W dx + (dq/dp) dp. The functions return
the element, in the plane as it is, and dq/dp, (8, 8).
"""

from collections.abc import Callable

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits.elements import (
    DIRECTION,
    LEAST_POINTS,
    N_VALUES,
    PLACE,
    RADIUS,
    Element,
    element_values,
    fitted_element,
    positive_radius,
    turned_towards,
)
from traverse.kinematics.fits.shapes import (
    Cloud,
    adjusted,
    checked_points,
    cloud_of,
    turned_positive,
)
from traverse.kinematics.model.geometry import across


def circle_element(
    points_mm: Floats, plane: Element, offset_mm: float = 0.0
) -> tuple[Element, Floats]:
    """Fit a circle to balls' centres, projected into a plane.

    Args:
        points_mm: (n_points, 3).
        plane: in which the centre lies.
        offset_mm: by so much the surface is further out.
    """
    points_mm = checked_points(points_mm, LEAST_POINTS["circle"])
    normal = plane.direction
    first, second = across(normal)
    basis = np.stack([first, second], axis=1)
    heights_mm = (points_mm - plane.place_mm) @ normal
    flat = _flat_cloud(points_mm, basis, "circle")
    flat_points = flat.points @ basis
    linearised, moved = _circle_functions(flat_points)
    (centre, radius), _, _ = adjusted(
        _circle_start(flat_points), linearised, moved, "circle"
    )
    centre_mm = flat.mean_mm + flat.extent_mm * (basis @ centre)
    centre_mm += normal * float((plane.place_mm - centre_mm) @ normal)
    radius_mm = flat.extent_mm * radius
    in_plane = (points_mm - centre_mm) @ basis
    lengths_mm = np.linalg.norm(in_plane, axis=1)
    normals = (in_plane / lengths_mm[:, np.newaxis]) @ basis.T
    design = np.column_stack([normals @ basis, np.ones(len(normals))])
    by_freedoms = np.zeros((N_VALUES, 3))
    by_freedoms[PLACE, 0], by_freedoms[PLACE, 1] = first, second
    by_freedoms[RADIUS, 2] = 1.0
    values = element_values(centre_mm, normal, positive_radius(radius_mm + offset_mm))
    equations = lengths_mm - radius_mm, normals, design
    circle = fitted_element("circle", values, by_freedoms, points_mm, equations)
    # A plane that tilts by dn moves the projections by -h dn.
    tilts = -(heights_mm[:, np.newaxis] * normals)
    by_tilts = by_freedoms @ np.linalg.pinv(design) @ tilts
    return circle, _by_plane(circle, by_tilts, plane)


def line_in_plane_element(
    points_mm: Floats,
    plane: Element,
    tip_mm: float = 0.0,
    outwards: Floats | None = None,
) -> tuple[Element, Floats]:
    """Fit the line of an edge to balls' centres, projected into a plane.

    Args:
        points_mm: (n_points, 3).
        plane: in which the line lies.
        tip_mm: radius of the ball.
        outwards: about where the edge faces, away from the material, (3,).
    """
    points_mm = checked_points(points_mm, LEAST_POINTS["line"])
    normal = plane.direction
    basis = np.stack(across(normal), axis=1)
    heights_mm = (points_mm - plane.place_mm) @ normal
    flat = _flat_cloud(points_mm, basis, "line")
    direction = turned_positive(flat.axes[0])
    direction -= normal * float(direction @ normal)
    direction /= np.linalg.norm(direction)
    facing = np.cross(normal, direction)
    if outwards is not None:
        facing = turned_towards(facing, outwards)
    place_mm = flat.mean_mm + normal * float((plane.place_mm - flat.mean_mm) @ normal)
    along_mm = (points_mm - place_mm) @ direction
    design = np.column_stack([np.ones(len(along_mm)), along_mm])
    by_freedoms = np.zeros((N_VALUES, 2))
    by_freedoms[PLACE] = np.stack([facing, tip_mm * direction], axis=1)
    by_freedoms[DIRECTION, 1] = facing
    normals = np.broadcast_to(facing, points_mm.shape)
    values = element_values(place_mm - tip_mm * facing, direction)
    equations = (points_mm - place_mm) @ facing, normals, design
    line = fitted_element("line", values, by_freedoms, points_mm, equations)
    tilts = -(heights_mm[:, np.newaxis] * normals)
    by_tilts = by_freedoms @ np.linalg.pinv(design) @ tilts
    return line, _by_plane(line, by_tilts, plane)


def _by_plane(element: Element, by_tilts: Floats, plane: Element) -> Floats:
    """Differentiate an element by the plane that it lies in.

    Args:
        element: fitted in the plane as it is.
        by_tilts: dq/dn of the fit, by the projections that a tilt dn moves, (8, 3).
        plane: the plane.
    """
    normal, by_plane = plane.direction, np.zeros((N_VALUES, N_VALUES))
    by_plane[:, DIRECTION] = by_tilts
    # It stays in the plane: n . (c - p) = 0; directions stay across it, or along.
    by_plane[PLACE, PLACE] += np.outer(normal, normal)
    by_plane[PLACE, DIRECTION] += np.outer(normal, plane.place_mm - element.place_mm)
    if element.kind == "circle":
        by_plane[DIRECTION, DIRECTION] += np.eye(3)
    else:
        by_plane[DIRECTION, DIRECTION] -= np.outer(normal, element.direction)
    return by_plane


def _flat_cloud(points_mm: Floats, basis: Floats, shape: str) -> Cloud:
    cloud = cloud_of(points_mm @ basis @ basis.T, LEAST_POINTS["line"])
    if shape == "circle":
        cloud.refuse_degenerate(shape, flat=False)
    return cloud


_Circle = tuple[Floats, float]


def _circle_start(flat: Floats) -> _Circle:
    """Fit centre and radius algebraically to (n_points, 2)."""
    design = np.column_stack([2.0 * flat, np.ones(len(flat))])
    solution = np.linalg.lstsq(design, np.sum(flat**2, axis=1), rcond=None)[0]
    centre = solution[:2]
    return centre, float(np.sqrt(solution[2] + centre @ centre))


def _circle_functions(
    flat: Floats,
) -> tuple[
    Callable[[_Circle], tuple[Floats, Floats]], Callable[[_Circle, Floats], _Circle]
]:
    """Return `linearised` and `moved` of a circle through (n_points, 2)."""

    def linearised(state: _Circle) -> tuple[Floats, Floats]:
        from_centre = flat - state[0]
        lengths = np.linalg.norm(from_centre, axis=1)
        if not np.all(lengths > 0.0):
            raise ValueError("a point lies in the centre of the circle; leave it out")
        design = np.column_stack(
            [-from_centre / lengths[:, np.newaxis], -np.ones(len(flat))]
        )
        return lengths - state[1], design

    def moved(state: _Circle, step: Floats) -> _Circle:
        return state[0] + step[:2], state[1] + float(step[2])

    return linearised, moved
