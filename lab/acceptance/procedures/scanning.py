"""Scanned spheres and flats, by ISO 10360-8: where an arm scans.

The places are centres of a ball that is drawn over the surface, or points that a sensor
found on it, whose tip has the radius 0. Directions and distances are about the
least-squares sphere of all points, heights above the least-squares plane. D95% is the
narrowest shell or slab about it that holds 95 % of the points.
"""

from collections.abc import Iterator
from math import ceil

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits import fit_plane
from traverse.lab.acceptance.budget import SMOOTH_FORM_OF_ALL, form_budget
from traverse.lab.acceptance.conformity import Missing, Part, Scatter, judged_figure
from traverse.lab.acceptance.limits import Limits
from traverse.lab.acceptance.procedures.length_tests import length_test
from traverse.lab.acceptance.procedures.lengths import refuse_few
from traverse.lab.acceptance.procedures.point_distribution import pattern_25
from traverse.lab.acceptance.procedures.probing import (
    diameter_budget,
    diameter_remarks,
    location,
)
from traverse.lab.artefacts.plane import Plane
from traverse.lab.measured_points.measurement import (
    SCANNED,
    IncompleteError,
    Measurement,
    certified_sphere,
    fitted_sphere,
)

SPHERE, FLAT = f"{SCANNED}sphere", f"{SCANNED}flat"
LOCATION = f"{SCANNED}articulated"
# Ten of so many points may lie outside of the 95 %; Traverse's own choice.
LEAST_POINTS = 200
_HELD = 0.95
_FARTHEST_DEG = 15.0
_CELL = 0.2  # edge of a cell, in radii
_MOST_SHOWN = 500

_OF_25 = (
    "of 25 points of a scanned sphere, those nearest to 1 direction on the pole, 4 at "
    "22.5, 8 at 45, 4 at 67.5 and 8 at 90 degrees from it"
)
_BY_KEY = {
    "scan_form_25": (
        "P_Form.Sph.1x25",
        f"{_OF_25}: max|p - c| - min|p - c| about their least-squares sphere (c, r)",
    ),
    "scan_form_95": (
        "P_Form.Sph.D95%",
        "of all points of a scanned sphere: width of the narrowest shell about the "
        "centre of their least-squares sphere that holds 95 % of them",
    ),
    "scan_size_25": ("P_Size.Sph.1x25", f"{_OF_25}: 2 r - D_cal, with sign"),
    "scan_size_all": (
        "P_Size.Sph.All",
        "of all points of a scanned sphere: least-squares sphere (c, r), 2 r - D_cal, "
        "with sign",
    ),
    "scan_flat_95": (
        "E_Form.Pla.D95%",
        "of all points of a scanned flat: distance of the two nearest planes parallel "
        "to their least-squares plane that hold 95 % of them between",
    ),
}


def scanning(measured: Measurement, limits: Limits) -> Iterator[Part]:
    """The figures of `scan-sphere`, `scan-articulated` and `scan-flat`, and lengths."""
    yield from _of_sphere(measured, limits)
    yield from location(measured, LOCATION, limits, "scan_l_dia")
    yield from _of_flat(measured, limits)
    yield from length_test(measured, "scan_e_uni", limits)
    yield from length_test(measured, "scan_e_bi", limits)


def _of_sphere(measured: Measurement, limits: Limits) -> Iterator[Part]:
    scanned = measured.of(SPHERE)
    try:
        sphere = certified_sphere(measured.artefacts.get(SPHERE), SPHERE)
        refuse_few(scanned, SPHERE, LEAST_POINTS)
        every = fitted_sphere(sphere, scanned, SPHERE)
        outwards = scanned.places_mm - every.centre_mm
        chosen = scanned.part(representatives(outwards, SPHERE))
        of_25 = fitted_sphere(sphere, chosen, f"{SPHERE}, 25 points")
    except IncompleteError as error:
        for key in ("scan_form_25", "scan_form_95", "scan_size_25", "scan_size_all"):
            yield Missing(_BY_KEY[key][0], (str(error),))
        return
    form = form_budget(limits.standards)
    size = diameter_budget(sphere, chosen, of_25, limits)
    of_all = diameter_budget(sphere, chosen, of_25, limits, SMOOTH_FORM_OF_ALL)
    for key, value_mm, budget in (
        ("scan_form_25", of_25.form_mm, form),
        ("scan_form_95", narrowest_mm(every.off_mm), form),
        ("scan_size_25", of_25.size_mm, size),
        ("scan_size_all", every.size_mm, of_all),
    ):
        yield judged_figure(
            limits,
            key,
            *_BY_KEY[key],
            value_mm,
            budget=budget,
            remarks=diameter_remarks(sphere, SPHERE),
        )
    yield _shown(SPHERE, every.off_mm)


def _of_flat(measured: Measurement, limits: Limits) -> Iterator[Part]:
    scanned, artefact = measured.of(FLAT), measured.artefacts.get(FLAT)
    title, definition = _BY_KEY["scan_flat_95"]
    try:
        if not isinstance(artefact, Plane):
            kind = "not among the artefacts" if artefact is None else artefact.kind
            raise IncompleteError(f"{FLAT}: is {kind}, expected a plane")
        refuse_few(scanned, FLAT, LEAST_POINTS)
        plane = fit_plane(scanned.places_mm)
    except ValueError as error:
        yield Missing(title, (str(error),))
        return
    heights_mm = (scanned.places_mm - plane.point_mm) @ plane.normal
    yield judged_figure(
        limits,
        "scan_flat_95",
        title,
        definition,
        narrowest_mm(heights_mm),
        budget=form_budget(limits.standards, artefact),
        parts=(("all points", float(np.ptp(heights_mm))),),
    )
    yield _shown(FLAT, heights_mm)


def narrowest_mm(heights_mm: Floats) -> float:
    """Return the width of the narrowest interval that holds 95 % of n heights, (n,)."""
    ordered = np.sort(heights_mm)
    n_held = ceil(_HELD * len(ordered) - 1e-9)
    widths_mm = ordered[n_held - 1 :] - ordered[: len(ordered) - n_held + 1]
    return float(widths_mm.min())


def representatives(outwards: Floats, name: str) -> list[int]:
    """Choose 25 points that are spread evenly over the half sphere of a scan.

    Where the probe stayed longer there are more points, which must not draw the pole
    to them: it is the middle of the cells that the scan went through.

    Of n points, (n, 3) from the centre; returns rows in the order of the pattern.

    Raises:
        IncompleteError: Not every direction has a point of its own near to it.
    """
    units = outwards / np.linalg.norm(outwards, axis=1, keepdims=True)
    middle = np.unique(np.round(units / _CELL), axis=0).mean(axis=0) * _CELL
    # Points all around have no middle, and any pole is as good as another.
    length = float(np.linalg.norm(middle))
    pole = middle / length if length > 0.1 else np.array([0.0, 0.0, 1.0])
    likeness = pattern_25(pole) @ units.T
    rows = np.argmax(likeness, axis=1)
    near = likeness.max(axis=1) >= np.cos(np.radians(_FARTHEST_DEG))
    n_near = len(np.unique(rows[near]))
    if n_near < len(rows):
        raise IncompleteError(
            f"{name}: has a point of its own within {_FARTHEST_DEG:g} degrees of "
            f"{n_near} of 25 directions; scan the whole half sphere"
        )
    return [int(row) for row in rows]


def _shown(name: str, off_mm: Floats) -> Scatter:
    """Keep as many distances as a picture shows, evenly taken."""
    step = -(-len(off_mm) // _MOST_SHOWN)
    title = name if step == 1 else f"{name}, one point in {step}"
    return Scatter(title, tuple(off_mm[::step].tolist()))
