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

Samples of a scan that follow each other are not independent: contact, form and the
encoders' lines are nearly the same for neighbours. Of n samples of one scan on one
feature only n / m count, and the variance that each has for itself is m-fold, with the
larger of

- n over the number of pieces of 0.25 s that they are from (`SAMPLES_OF_ONE_TOUCH_NS`),
- 1 + 2 sum of the autocorrelations of their residuals, up to the first that is not
  positive: the variance of a mean of correlated values (N. F. Zhang, Metrologia 43
  (2006) S276).

And how hard a hand presses stays what it is all along a scan: once, the stated noise of
one sample is an error along the normals that all samples of the scan share.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
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

SAMPLES_OF_ONE_TOUCH_NS = 250_000_000  # a hand needs as long to change its force
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
        scans: number of the scan that each is a sample of, (n_touches,), -1: of none;
            samples of one are in their order. None: no scans.
        times_ns: of samples, (n_touches,).
    """

    errors: JointCovariance
    tip_mm: float
    tip_std_mm: float
    towards: Floats
    is_measured: Booleans
    scans: Integers | None = None
    times_ns: Integers | None = None


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
    rows_of: dict[str, Integers] = {}
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
            rows_of[definition.name] = np.array(definition.rows)
        except ValueError as error:
            problems[definition.name] = str(error)
    fits = [element.fit for element in elements.values() if element.fit is not None]
    errors = _with_form(touches.errors, fits)
    errors = _with_scans(errors, elements, rows_of, touches)
    errors = _with_tip(errors, fits, touches.tip_std_mm)
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
    ways = np.zeros_like(errors.points_mm)
    for fit in fits:
        np.add.at(ways, fit.rows, fit.by_tip[:, np.newaxis] * fit.normals)
    return _with_shared(errors, tip_std_mm * ways)


def _with_scans(
    errors: JointCovariance,
    elements: dict[str, Element],
    rows_of: Mapping[str, Integers],
    touches: Touches,
) -> JointCovariance:
    """Have samples of scans count as often as they are independent, also in fits."""
    if touches.scans is None or touches.times_ns is None:
        return errors
    repeats = np.ones(len(errors.points_mm))
    pressed_mm = []
    for name, rows in rows_of.items():
        fit, scans = elements[name].fit, touches.scans[rows]
        for scan in np.unique(scans[scans >= 0]):
            its_rows = rows[scans == scan]
            pieces = np.unique(touches.times_ns[its_rows] // SAMPLES_OF_ONE_TOUCH_NS)
            repeats[its_rows] = len(its_rows) / len(pieces)
            if fit is not None:
                is_its = np.isin(fit.rows, its_rows)
                residuals_mm = fit.distances_mm[is_its].reshape(len(its_rows), -1)
                together = _correlated(residuals_mm)
                repeats[its_rows] = np.maximum(repeats[its_rows], together)
                pressed_mm.append(_pressed_mm(touches.errors, fit, is_its))
        if fit is not None:
            fit = replace(fit, repeats=repeats[fit.rows])
            elements[name] = replace(elements[name], fit=fit)
    more_mm2 = (repeats - 1.0)[:, np.newaxis, np.newaxis] * errors.own_mm2
    errors = replace(errors, covariances_mm2=errors.covariances_mm2 + more_mm2)
    for ways_mm in pressed_mm:
        errors = _with_shared(errors, ways_mm)
    return errors


def _pressed_mm(errors: JointCovariance, fit: Fit, is_its: Booleans) -> Floats:
    """Return by how much a hand's force moves samples of a scan, (n_touches, 3)."""
    normals, rows = fit.normals[is_its], fit.rows[is_its]
    own_mm2 = errors.own_mm2[rows]
    variances_mm2 = np.einsum("ia,iab,ib->i", normals, own_mm2, normals)
    ways_mm = np.zeros_like(errors.points_mm)
    std_mm = np.sqrt(max(float(variances_mm2.mean()), 0.0))
    np.add.at(ways_mm, rows, std_mm * normals)
    return ways_mm


def _correlated(residuals_mm: Floats) -> float:
    """Return how many of residuals in their order, (n, n_each), count as one."""
    squares_mm2 = float(np.sum(residuals_mm**2))
    total = 1.0
    for lag in range(1, len(residuals_mm)):
        products_mm2 = float(np.sum(residuals_mm[lag:] * residuals_mm[:-lag]))
        if products_mm2 <= 0.0:
            break
        total += 2.0 * products_mm2 / squares_mm2
    return total


def _with_shared(errors: JointCovariance, shared_mm: Floats) -> JointCovariance:
    """Add an error that touches share, (n_touches, 3)."""
    column_mm = shared_mm[..., np.newaxis]
    return replace(
        errors,
        covariances_mm2=errors.covariances_mm2
        + column_mm @ column_mm.transpose(0, 2, 1),
        shared_mm=np.concatenate([errors.shared_mm, column_mm], axis=2),
    )
