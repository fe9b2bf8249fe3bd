"""Features from touches: elements compensated by the side touched, and their errors.

All features of a part are functions of the same touches, whose joint covariance has
their common errors by the arm. Each keeps its derivatives W by all touches, so that
values of several features have the right uncertainty, also where two share touches.

What the stated noise does not explain is form, or worse: with residuals r of a fit, R
its projector, C the stated covariance of the distances and nu the redundancy,

    s^2 = max(0, (r^T r - tr(R C)) / nu)

is added to the variance of each of its touches along the normal.

The ball's radius is the same for all touches. A ball that is larger by dr does to an
element what touches do that are all moved by dr to the side of the material: so it is
one more thing that they share.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.fits.elements import (
    Element,
    Fit,
    Kind,
    line_element,
    plane_element,
    point_element,
    sphere_element,
)
from traverse.kinematics.fits.elements_about_axis import cone_element, cylinder_element
from traverse.kinematics.fits.elements_in_plane import (
    circle_element,
    line_in_plane_element,
)
from traverse.kinematics.uncertainty.joint_covariance import JointCovariance

MOST_TOUCHES = 2000  # of a feature: its projector has the square of that
Side = Literal["auto", "inside", "outside", "centre"]
_ROUND: dict[Kind, Callable[[Floats, float], Element]] = {
    "sphere": sphere_element,
    "cylinder": cylinder_element,
    "cone": cone_element,
}


@dataclass(frozen=True, slots=True)
class Definition:
    """A feature and its touches.

    Attributes:
        rows: of the touches.
        side: from which the surface was touched; "auto": as the touches' compensation
            tells, of planes and edges also the shank; "centre": not compensated.
        plane: name of the plane that a circle, or an edge, lies in; a circle without
            one is in the plane of its own touches, a line in space.
    """

    name: str
    kind: Kind
    rows: tuple[int, ...]
    side: Side = "auto"
    plane: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Touches:
    """All touches of a part.

    Attributes:
        errors: the balls' centres with their joint covariance.
        tip_mm: radius of the ball.
        tip_std_mm: standard uncertainty of the radius.
        towards: unit vectors to the material, else of the shank, (n_touches, 3).
        is_measured: whether these are directions to the material, (n_touches,).
    """

    errors: JointCovariance
    tip_mm: float
    tip_std_mm: float
    towards: Floats
    is_measured: Booleans


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Features that were measured.

    Attributes:
        elements: by name, their derivatives by all touches.
        errors: of all touches, with errors that fits found beyond the stated noise.
        problems: why others could not be computed, by name.
    """

    elements: dict[str, Element]
    errors: JointCovariance
    problems: dict[str, str]


def measured_features(definitions: Iterable[Definition], touches: Touches) -> Features:
    """Compute features; planes first, as others are measured in them."""
    elements: dict[str, Element] = {}
    problems: dict[str, str] = {}
    for definition in definitions:
        try:
            plane = None
            if definition.plane is not None:
                plane = elements.get(definition.plane)
                if plane is None or plane.kind != "plane":
                    raise ValueError(
                        f"{definition.plane} is no plane that was measured before"
                    )
            elements[definition.name] = _element(definition, touches, plane)
        except ValueError as error:
            problems[definition.name] = str(error)
    errors = touches.errors
    fits = [element.fit for element in elements.values() if element.fit is not None]
    errors = _with_tip(_with_form(errors, fits), fits, touches.tip_std_mm)
    return Features(elements, errors, problems)


def _element(
    definition: Definition, touches: Touches, plane: Element | None
) -> Element:
    rows, kind = list(definition.rows), definition.kind
    if len(rows) > MOST_TOUCHES:
        raise ValueError(
            f"{len(rows)} touches, at most {MOST_TOUCHES} of one feature are computed; "
            "thin them out"
        )
    points_mm, n = touches.errors.points_mm[rows], len(touches.errors.points_mm)
    tip_mm = 0.0 if definition.side == "centre" else touches.tip_mm
    outwards = -touches.towards[rows].sum(axis=0) if tip_mm else None
    if kind == "point":
        known = touches.is_measured[rows, np.newaxis] & (tip_mm > 0.0)
        ways = np.where(known, touches.towards[rows], 0.0)
        return _of_all(point_element(points_mm + tip_mm * ways), rows, n, ways.ravel())
    inwards = -np.sign(tip_mm)
    if kind == "plane":
        element = plane_element(points_mm, tip_mm, outwards)
        return _of_all(element, rows, n, inwards)
    if kind == "line":
        if plane is None:
            return _of_all(line_element(points_mm), rows, n)
        line, by_plane = line_in_plane_element(points_mm, plane, tip_mm, outwards)
        return _with_plane(_of_all(line, rows, n, inwards), by_plane, plane)
    offset_mm = _offset_mm(definition, touches, plane)
    by_tip = np.sign(offset_mm)
    if kind != "circle":
        return _of_all(_ROUND[kind](points_mm, offset_mm), rows, n, by_tip)
    if plane is None:
        plane = _of_all(plane_element(points_mm), rows, n)
    circle, by_plane = circle_element(points_mm, plane, offset_mm)
    return _with_plane(_of_all(circle, rows, n, by_tip), by_plane, plane)


def _offset_mm(
    definition: Definition, touches: Touches, plane: Element | None
) -> float:
    """Return how far the surface of a round feature is outside of the balls' centres.

    Raises:
        ValueError: the side is not known.
    """
    rows, side = list(definition.rows), definition.side
    if side == "centre" or touches.tip_mm == 0.0:
        return 0.0
    if side == "auto":
        if not touches.is_measured[rows].all():
            raise ValueError(
                "whether it was touched from inside or from outside is not known; say "
                "which, or touch with tip compensation (pretouch or pulled)"
            )
        of_centres = _element(replace(definition, side="centre"), touches, plane).fit
        normals = touches.towards[rows] if of_centres is None else of_centres.normals
        along = np.einsum("ij,ij->i", normals, touches.towards[rows])
        if not (np.all(along > 0.0) or np.all(along < 0.0)):
            raise ValueError("some touches are from inside, others from outside")
        side = "inside" if along[0] > 0.0 else "outside"
    return touches.tip_mm if side == "inside" else -touches.tip_mm


def _of_all(
    element: Element, rows: list[int], n: int, by_tip: Floats | float = 0.0
) -> Element:
    """Return an element whose derivatives and rows are of all n touches."""
    by_points = np.zeros((len(element.values), n, 3))
    by_points[:, rows] = element.by_points
    fit = element.fit
    if fit is not None:
        by_tip = np.broadcast_to(by_tip, fit.distances_mm.shape)
        fit = replace(fit, rows=np.array(rows)[fit.rows], by_tip=by_tip)
    return replace(element, by_points=by_points, fit=fit)


def _with_plane(element: Element, by_plane: Floats, plane: Element) -> Element:
    """Add the effect of the plane's errors on an element in it."""
    by_points = element.by_points + np.einsum("qp,pni->qni", by_plane, plane.by_points)
    return replace(element, by_points=by_points)


def _with_form(errors: JointCovariance, fits: list[Fit]) -> JointCovariance:
    covariances_mm2 = errors.covariances_mm2.copy()
    for fit in fits:
        if fit.redundancy == 0:
            continue
        rows, normals = fit.rows, fit.normals
        same = rows[:, np.newaxis] == rows
        stated = same * np.einsum(
            "ia,iab,jb->ij", normals, errors.own_mm2[rows], normals
        )
        shared = np.einsum("ia,iar->ir", normals, errors.shared_mm[rows])
        stated += shared @ shared.T
        explained_mm2 = float(np.sum(fit.residual_projector * stated))
        squares_mm2 = float(fit.distances_mm @ fit.distances_mm)
        variance_mm2 = max(0.0, squares_mm2 - explained_mm2) / fit.redundancy
        form_mm2 = variance_mm2 * np.einsum("ia,ib->iab", normals, normals)
        np.add.at(covariances_mm2, rows, form_mm2)
    return replace(errors, covariances_mm2=covariances_mm2)


def _with_tip(
    errors: JointCovariance, fits: list[Fit], tip_std_mm: float
) -> JointCovariance:
    """Add the error of the ball's radius to the common errors of touches."""
    ways = np.zeros((len(errors.points_mm), 3, 1))
    for fit in fits:
        np.add.at(ways[..., 0], fit.rows, fit.by_tip[:, np.newaxis] * fit.normals)
    shared_mm = tip_std_mm * ways
    return replace(
        errors,
        covariances_mm2=errors.covariances_mm2
        + shared_mm @ shared_mm.transpose(0, 2, 1),
        shared_mm=np.concatenate([errors.shared_mm, shared_mm], axis=2),
    )
