"""Common points: the touches of one name, as one place with its covariance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits import fit_sphere
from traverse.lab.alignment.touches import Touch


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A named place in one system.

    Attributes:
        place_mm: (3,).
        covariance_mm2: (3, 3); None where it is not known.
        touches: How many it was made of.
        spread_mm: Root mean square distance from their mean, or from the sphere.
    """

    place_mm: Floats
    covariance_mm2: Floats | None
    touches: int = 1
    spread_mm: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class CommonPoints:
    """Places that are known in two systems.

    Attributes:
        names: (n,).
        measured: In the arm's system, (n,).
        nominal: In the system that it leads to, (n,).
    """

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
    """Sort touches by name, and make one place of each name.

    The covariance of a mean is the mean of the covariances, not divided by their
    number: an arm's errors in one place are much the same each time.

    Args:
        touches: In their order.
        known: Names that count; None: all.
        std_mm: Of every coordinate of a touch; None: as the touches say.
        spheres: Whether a name's touches lie on a sphere whose centre counts.

    Returns:
        Places by name, and remarks on touches that were left out or are doubtful.

    Raises:
        ValueError: Touches of a name are no sphere.
    """
    groups: dict[str, list[Touch]] = {}
    nameless = unknown = 0
    for touch in touches:
        among = touch.names if known is None else known
        name = touch.name_among(among)
        if name is None:
            nameless += not touch.names
            unknown += bool(touch.names)
            continue
        groups.setdefault(name, []).append(touch)
    remarks = []
    if nameless:
        remarks.append(f"{nameless} touches have no name and are left out")
    if unknown:
        remarks.append(
            f"{unknown} touches have names that the other side does not know, and are "
            "left out"
        )
    for name, group in groups.items():
        flags = sorted({flag for touch in group for flag in touch.flags})
        if flags:
            remarks.append(f"{name}: touches carry flags: {', '.join(flags)}")
    make = _sphere_centre if spheres else _mean_place
    return {
        name: make(name, group, stated_covariances(group, std_mm))
        for name, group in groups.items()
    }, remarks


def stated_covariances(touches: Sequence[Touch], std_mm: float | None) -> Floats | None:
    """List the covariances of touches, (n, 3, 3); None where one is not known."""
    if std_mm is not None:
        return np.tile(std_mm**2 * np.eye(3), (len(touches), 1, 1))
    found = [touch.covariance_mm2 for touch in touches]
    known = [covariance for covariance in found if covariance is not None]
    return np.array(known) if len(known) == len(found) else None


def _mean_place(name: str, group: Sequence[Touch], covariances: Floats | None) -> Place:
    del name
    places_mm = np.array([touch.place_mm for touch in group])
    mean_mm = places_mm.mean(axis=0)
    spread_mm = float(np.sqrt(np.mean(np.sum((places_mm - mean_mm) ** 2, axis=1))))
    covariance = None if covariances is None else covariances.mean(axis=0)
    return Place(mean_mm, covariance, len(group), spread_mm if len(group) > 1 else None)


def _sphere_centre(
    name: str, group: Sequence[Touch], covariances: Floats | None
) -> Place:
    """Fit a sphere; a touch scatters as stated, or as the fit says if that is more."""
    try:
        sphere = fit_sphere(np.array([touch.place_mm for touch in group]))
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
    found_mm = sphere.precision.std_mm
    covariance = None
    if covariances is not None:
        stated_mm = float(np.sqrt(np.mean(np.einsum("nii->n", covariances)) / 3.0))
        std_mm = max(stated_mm, found_mm or 0.0)
        covariance = sphere.precision.covariance(std_mm)[:3, :3]
    elif found_mm is not None:
        covariance = sphere.precision.covariance(found_mm)[:3, :3]
    return Place(sphere.centre_mm, covariance, len(group), sphere.rms_mm)


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
