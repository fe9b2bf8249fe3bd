"""Systems made of features: the part's, and the first station's after a leapfrog.

A station is a place of the arm. Results of a part are in the system of the first one;
touches from later ones are brought there, with the errors of where the arm stands,
which all touches of a station share.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.client.inspection.best_fit import BestFit, best_fit, leapfrog_fit
from traverse.client.inspection.plan import Plan
from traverse.client.inspection.results import assigned_points, features_of_arm
from traverse.kinematics.features.datum import datum_system
from traverse.kinematics.helmert.transformation import N_RIGID, Helmert, motions
from traverse.kinematics.uncertainty.joint_covariance import covariances_of
from traverse.protocol.messages import Point
from traverse.protocol.messages.fields import Vector

_UPPER = np.triu_indices(3)  # as of `Point.covariance_mm2`


@dataclass(frozen=True, slots=True, eq=False)
class Station:
    """A position of the arm's base after a move.

    Attributes:
        system: from the arm's system there to that of the first station.
        centre_mm: about which `factor` is stated, in the first one's system.
        factor: F of the covariance F F' of shift and turn, (6, 6).
    """

    system: Helmert
    centre_mm: Floats
    factor: Floats

    def shared_mm(self, place_mm: Floats) -> Floats:
        """Return what places of this station share by it, (3, 6)."""
        away_mm = (place_mm - self.centre_mm)[np.newaxis]
        shared: Floats = motions(away_mm, N_RIGID)[0] @ self.factor
        return shared


def station_of_fit(fit: BestFit) -> Station:
    factor = np.asarray(np.linalg.cholesky(fit.covariance), dtype=np.float64)
    return Station(fit.system, fit.centre_mm, factor)


def system_of_datums(
    plan: Plan, points: Sequence[Point], names: Sequence[str]
) -> Helmert:
    """Return the part's system by 3-2-1 of a plane, a line and a point, by their names.

    The line leads from its first touch to its last.

    Raises:
        ValueError: they are not measured, or make no system.
    """
    features, _ = features_of_arm(plan, points, "not needed")
    for name in names:
        if name not in features.elements:
            raise ValueError(f"{name}: {features.problems.get(name, 'not measured')}")
    plane, line, point = (features.elements[name] for name in names)
    of_line = assigned_points(plan, points)[names[1]]
    forwards = np.subtract(of_line[-1].xyz_mm, of_line[0].xyz_mm)
    return datum_system(plane, line, point, forwards)


def system_by_best_fit(
    plan: Plan,
    points: Sequence[Point],
    shared_mm: Mapping[str, Floats] | str,
    nominals_mm: Mapping[str, Vector],
) -> BestFit:
    """Return the part's system by a best fit of features onto nominal places.

    Args:
        plan: with the features; where it states the part's temperature, nominal places
            at 20 °C are taken as long as the part is now.
        points: as of `inspected`.
        shared_mm: as of `inspected`.
        nominals_mm: by feature.

    Raises:
        ValueError: they are not measured, or do not determine it.
    """
    features, is_known = features_of_arm(plan, points, shared_mm)
    of_part = plan.part_temperature
    length = 1.0 if of_part is None else of_part.expansion.length
    return best_fit(
        features,
        {
            name: (length * x_mm, length * y_mm, length * z_mm)
            for name, (x_mm, y_mm, z_mm) in nominals_mm.items()
        },
        is_known=is_known,
    )


def system_by_leapfrog(
    plan: Plan,
    points: Sequence[Point],
    shared_mm: Mapping[str, Floats] | str,
    before_by_again: Mapping[str, str],
) -> BestFit:
    """Return the first station's system by features that were touched once more.

    Args:
        plan: with the features, those of `before_by_again` both times.
        points: of the first station's system, but touches of the new features as taken.
        shared_mm: as of `inspected`.
        before_by_again: names of the features touched again, and before.

    Raises:
        ValueError: they are not measured, or do not determine it.
    """
    features, is_known = features_of_arm(plan, points, shared_mm)
    return leapfrog_fit(features, before_by_again, is_known=is_known)


def in_first_system(
    points: Sequence[Point],
    shared_mm: Mapping[str, Floats] | str,
    stations: Sequence[Station],
    station_by_point: Mapping[str, int],
) -> tuple[list[Point], Mapping[str, Floats] | str]:
    """Bring touches into the first station's system, with the errors of theirs.

    Args:
        points: as taken.
        shared_mm: as of `inspected`.
        stations: after the first.
        station_by_point: numbers in `stations`, by point; else it is of the first.
    """
    if not stations:
        return list(points), shared_mm
    placed, widened = [], dict[str, Floats]()
    for point in points:
        number = station_by_point.get(point.id)
        shared = None if isinstance(shared_mm, str) else shared_mm.get(point.id)
        if number is None:
            by_stations = np.zeros((3, N_RIGID * len(stations)))
            moved = point.model_copy(update={"part_xyz_mm": None})
        else:
            station = stations[number]
            moved, by_stations = _moved(point, station, number, len(stations))
            shared = None if shared is None else station.system.rotation @ shared
        placed.append(moved)
        if shared is not None:
            widened[point.id] = np.concatenate([shared, by_stations], axis=1)
    return placed, shared_mm if isinstance(shared_mm, str) else widened


def _moved(
    point: Point, station: Station, number: int, n_stations: int
) -> tuple[Point, Floats]:
    """Return a point in the first system, and what it shares by stations, (3, 6 n)."""
    system, rotation = station.system, station.system.rotation
    place_mm = system.places_mm(np.array([point.xyz_mm]))[0]
    by_stations = np.zeros((3, N_RIGID * n_stations))
    by_station = station.shared_mm(place_mm)
    by_stations[:, N_RIGID * number : N_RIGID * (number + 1)] = by_station
    surface_mm, tensor = point.surface_mm, point.covariance_mm2
    if surface_mm is not None:
        surface_mm = tuple(system.places_mm(np.array([surface_mm]))[0].tolist())
    if tensor is not None:
        covariance = rotation @ covariances_of(np.array(tensor)) @ rotation.T
        tensor = tuple((covariance + by_station @ by_station.T)[_UPPER].tolist())
    values = {
        "xyz_mm": tuple(place_mm.tolist()),
        "ijk": tuple((rotation @ np.array(point.ijk)).tolist()),
        "surface_mm": surface_mm,
        "covariance_mm2": tensor,
        "part_xyz_mm": None,
    }
    return point.model_copy(update=values), by_stations
