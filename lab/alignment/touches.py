"""Touches with names: what an alignment is made of, from points or from a table.

The touches of one name become a common point: one place with its covariance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits import fit_sphere
from traverse.kinematics.uncertainty.joint_covariance import (
    JointCovariance,
    sphere_weights,
)
from traverse.plurals import counted
from traverse.protocol.messages import Point
from traverse.tables.reading import Table, open_table

Coordinates = Literal["centre", "surface"]

_PLACES = {
    "centre": ("x_mm", "y_mm", "z_mm"),
    "surface": ("surface_x_mm", "surface_y_mm", "surface_z_mm"),
}
_SHANK = ("i", "j", "k")
_TENSOR = tuple(
    f"covariance_{axes}_mm2" for axes in ("xx", "xy", "xz", "yy", "yz", "zz")
)


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """One measured place.

    Attributes:
        names: Possible names; the first one that is defined counts.
        place_mm: (3,).
        covariance_mm2: (3, 3); None if unknown.
        shared_mm: Factor of the part of it that all touches of an arm share, (3, rank).
        shank: Unit vector towards the ball, (3,); None if unknown.
        arm: Name of the arm; None if unknown.
        flags: What is doubtful about it.
        off_mm: How far from the touched surface the place is: the ball's radius for
            its centre; None if unknown.
    """

    names: tuple[str, ...]
    place_mm: Floats
    covariance_mm2: Floats | None = None
    shared_mm: Floats | None = None
    shank: Floats | None = None
    arm: str | None = None
    flags: tuple[str, ...] = ()
    off_mm: float | None = None


def names_of(artefact: str | None, feature: str | None) -> tuple[str, ...]:
    """List the names of a label: artefact/feature, feature, artefact."""
    both = f"{artefact}/{feature}" if artefact and feature else None
    return tuple(name for name in (both, feature, artefact) if name)


def touches_of_points(
    points: Sequence[Point], coordinates: Coordinates, shared_mm: Floats | None = None
) -> list[Touch]:
    """Make touches of captured points, none of which is taken back.

    Args:
        points: n of them.
        coordinates: Which.
        shared_mm: See `shared_by_points`, (n, 3, rank); None: not known.

    Raises:
        ValueError: A point has no touched place.
    """
    touches = []
    for row, point in enumerate(points):
        place = point.xyz_mm if coordinates == "centre" else point.surface_mm
        if place is None:
            raise ValueError(
                f"point {point.seq} of session {point.session} was taken without "
                "compensation, so it has no touched place; use --coordinates centre"
            )
        is_stated = point.covariance_mm2 is not None
        touch = Touch(
            names_of(point.label.artefact, point.label.feature),
            np.array(place),
            matrix_of(point.covariance_mm2) if point.covariance_mm2 else None,
            shared_mm[row] if shared_mm is not None and is_stated else None,
            np.array(point.ijk),
            point.arm,
            tuple(point.quality.flags),
            point.probe_radius_mm if coordinates == "centre" else 0.0,
        )
        touches.append(touch)
    return touches


def matrix_of(tensor: Sequence[float]) -> Floats:
    """Write xx, xy, xz, yy, yz, zz as a matrix."""
    xx, xy, xz, yy, yz, zz = tensor
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=np.float64)


def read_touch_table(path: Path, coordinates: Coordinates) -> list[Touch]:
    """Read a table: as `traverse points export` writes it, or name, x_mm, y_mm, z_mm.

    Of other columns std_mm, the covariance, i, j, k and flags are looked at.

    Raises:
        FileError: With all lines that cannot be used.
    """
    with open_table(path) as table:
        for name in _PLACES[coordinates]:
            if name not in table.header:
                table.refuse_header(f"column '{name}' is missing; add it")
        if not {"name", "artefact", "feature"} & set(table.header):
            problem = "column 'name' is missing; add it, or artefact, feature"
            table.refuse_header(problem)
        table.check()
        rows = list(table.rows_by_name(_PLACES[coordinates]))
        gone = {row.get("retracts", "") for _, row in rows} - {""}
        touches = [
            _row_touch(table, line, row, coordinates)
            for line, row in rows
            if not row.get("retracts") and row.get("id") not in gone
        ]
        table.check()
    return [touch for touch in touches if touch is not None]


_NO_PLACE = {
    "surface": "has no touched place: it was taken without compensation; use "
    "--coordinates centre",
    "centre": "has no coordinates",
}


def _row_touch(
    table: Table, line: int, row: Mapping[str, str], coordinates: Coordinates
) -> Touch | None:
    """Read a row; None where something is wrong, which is refused."""
    if not any(row[column] for column in _PLACES[coordinates]):
        table.refuse(line, _NO_PLACE[coordinates])
        return None
    place_mm, tensor, std_mm, radius_mm, shank = (
        table.vector(line, row, columns)
        for columns in (
            _PLACES[coordinates],
            _TENSOR,
            ("std_mm",),
            ("probe_radius_mm",),
            _SHANK,
        )
    )
    covariance = None if tensor is None else matrix_of(tensor.tolist())
    if std_mm is not None:
        if not std_mm[0] > 0.0:
            problem = f"is {std_mm[0]:g}, expected a length above zero"
            table.refuse(line, problem, "std_mm")
        covariance = std_mm[0] ** 2 * np.eye(3)
    if place_mm is None:
        return None
    names = names_of(row.get("artefact"), row.get("feature"))
    off_mm = None if radius_mm is None else float(radius_mm[0])
    return Touch(
        (row["name"],) if row.get("name") else names,
        place_mm,
        covariance,
        None,
        shank,
        None,
        tuple(row.get("flags", "").split()),
        off_mm if coordinates == "centre" else 0.0,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A named place in one system.

    Attributes:
        place_mm: (3,).
        covariance_mm2: (3, 3); None if unknown.
        touches: How many it was made of.
        spread_mm: Root mean square distance from their mean, or from the sphere.
        shared_mm: As of a touch, (3, rank); None if nothing is.
    """

    place_mm: Floats
    covariance_mm2: Floats | None
    touches: int = 1
    spread_mm: float | None = None
    shared_mm: Floats | None = None


def places_mm(touched: Sequence[Touch | Place]) -> Floats:
    """List where touches or places are, (n, 3)."""
    return np.array([touch.place_mm for touch in touched]).reshape(-1, 3)


@dataclass(frozen=True, slots=True, eq=False)
class CommonPoints:
    """Places that are known in the arm's system and in that it leads to, (n,) each."""

    names: tuple[str, ...]
    measured: tuple[Place, ...]
    nominal: tuple[Place, ...]


def places_by_name(
    touches: Sequence[Touch],
    known: Sequence[str] | None,
    *,
    std_mm: float | None,
    spheres: bool,
) -> tuple[dict[str, Place], list[str]]:
    """Sort touches by name, and make one place of each name that is known (None: all).

    What is of each touch alone is averaged for a mean, not divided by their number: an
    arm's errors in one place are much the same each time. The standard
    deviation is of every coordinate of a touch; None: as the touches say. Spheres:
    a name's touches lie on a sphere whose centre counts.

    Returns:
        Places by name, and remarks on touches that were left out or are doubtful.

    Raises:
        ValueError: Touches of a name are no sphere.
    """
    groups: dict[str, list[Touch]] = {}
    nameless = unknown = 0
    for touch in touches:
        names = (name for name in touch.names if known is None or name in known)
        name = next(names, None)
        if name is None:
            nameless += not touch.names
            unknown += bool(touch.names)
            continue
        groups.setdefault(name, []).append(touch)
    remarks = []
    if nameless:
        remarks.append(f"left out: {counted(nameless, 'touch')} without a name")
    if unknown:
        remarks.append(
            f"left out: {counted(unknown, 'touch')} with a name that the other side "
            "does not know"
        )
    for name, group in groups.items():
        flags = sorted({flag for touch in group for flag in touch.flags})
        if flags:
            remarks.append(f"{name}: touches carry flags: {', '.join(flags)}")
    make = _sphere_centre if spheres else _mean_place
    places = {}
    for name, group in groups.items():
        try:
            places[name] = make(group, stated_errors(group, std_mm))
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
    return places, remarks


def stated_errors(
    touches: Sequence[Touch], std_mm: float | None
) -> JointCovariance | None:
    """Return the errors of n touches as stated; None if those of one are unknown.

    What they share is known of all or, with rank 0, of none.
    """
    at_mm, n = places_mm(touches), len(touches)
    nothing = np.zeros((n, 3, 0))
    if std_mm is not None:
        of_each = np.tile(std_mm**2 * np.eye(3), (n, 1, 1))
        return JointCovariance(at_mm, of_each, nothing)
    stated = [t.covariance_mm2 for t in touches if t.covariance_mm2 is not None]
    if len(stated) < n:
        return None
    known = [touch.shared_mm for touch in touches if touch.shared_mm is not None]
    shared = np.array(known) if len(known) == n else nothing
    return JointCovariance(at_mm, np.array(stated), shared)


def _mean_place(group: Sequence[Touch], errors: JointCovariance | None) -> Place:
    at_mm = places_mm(group)
    mean_mm = at_mm.mean(axis=0)
    spread_mm = float(np.sqrt(np.mean(np.sum((at_mm - mean_mm) ** 2, axis=1))))
    covariance = shared = None
    if errors is not None:
        shared = errors.shared_mm.mean(axis=0)
        covariance = errors.own_mm2.mean(axis=0) + shared @ shared.T
    return Place(
        mean_mm,
        covariance,
        len(group),
        spread_mm if len(group) > 1 else None,
        shared,
    )


def _sphere_centre(group: Sequence[Touch], errors: JointCovariance | None) -> Place:
    """Fit a sphere; a touch scatters as stated, or as the fit says if that is more."""
    at_mm = places_mm(group)
    sphere = fit_sphere(at_mm)
    found_mm = sphere.precision.std_mm
    covariance = shared = None
    if errors is not None:
        own_mm2 = float(np.mean(np.einsum("nii->n", errors.own_mm2)) / 3.0)
        more = max(1.0, (found_mm or 0.0) ** 2 / own_mm2)
        both, shared_all = errors.combined(sphere_weights(at_mm, sphere))
        common = shared_all @ shared_all.T
        covariance = (common + more * (both - common))[:3, :3]
        shared = shared_all[:3]
    elif found_mm is not None:
        covariance = sphere.precision.covariance(found_mm)[:3, :3]
    return Place(sphere.centre_mm, covariance, len(group), sphere.rms_mm, shared)


def common_points(
    measured: Mapping[str, Place], nominal: Mapping[str, Place]
) -> CommonPoints:
    """Take the names that both sides have, in the order of the nominal ones."""
    names = tuple(name for name in nominal if name in measured)
    return CommonPoints(
        names,
        tuple(measured[name] for name in names),
        tuple(nominal[name] for name in names),
    )
