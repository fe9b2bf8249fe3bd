"""Measured points of each artefact, and its certificate.

Places of the ball's centre by artefact; of a cone how far they scatter, of a sphere the
least-squares one beside the calibrated one.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import groupby

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics import fits
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.kinematics.model.origins import near_origins
from traverse.kinematics.uncertainty.joint_covariance import JointCovariance
from traverse.lab.artefacts import Artefact
from traverse.lab.artefacts.ball_bar import BallBar
from traverse.lab.artefacts.plane import ParallelPlanes
from traverse.lab.artefacts.points import Points
from traverse.lab.artefacts.seats import Seats
from traverse.lab.artefacts.sphere import Sphere
from traverse.lab.campaign.campaign_file import NONE_STATED, Circumstances, Tool
from traverse.plurals import counted

# Beginning of the id of an artefact whose points are a scan: each counts by itself.
SCANNED = "scan-"


@dataclass(frozen=True, slots=True, eq=False)
class ArtefactTouches:
    """The touches of one artefact, in the order in which they were made.

    Attributes:
        places_mm: Centres of the ball, (n, 3).
        features: (n,).
        temperature_c: NaN where unknown, (n,).
        tip_mm: Radius of the ball, (n,).
        errors: Of the places; None where they are not known.
    """

    places_mm: Floats
    features: tuple[str, ...]
    temperature_c: Floats
    tip_mm: Floats
    errors: JointCovariance | None = None

    def __len__(self) -> int:
        return len(self.features)

    def part(self, rows: list[int]) -> "ArtefactTouches":
        return ArtefactTouches(
            self.places_mm[rows],
            tuple(self.features[row] for row in rows),
            self.temperature_c[rows],
            self.tip_mm[rows],
            None if self.errors is None else self.errors.part(rows),
        )

    def of(self, feature: str) -> "ArtefactTouches":
        rows = [row for row, name in enumerate(self.features) if name == feature]
        return self.part(rows)

    def runs(self) -> list["ArtefactTouches"]:
        """Cut where the feature changes."""
        runs = groupby(range(len(self)), key=self.features.__getitem__)
        return [self.part(list(rows)) for _, rows in runs]


@dataclass(frozen=True, slots=True)
class Occasion:
    """Operator, place and time of the measurement; None where it is not stated."""

    operator: str | None = None
    place: str | None = None
    circumstances: Circumstances = NONE_STATED
    first_utc: datetime | None = None
    last_utc: datetime | None = None
    campaign_digest: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """Everything that was touched, with the artefacts' certificates.

    Attributes:
        artefacts: By id, as the campaign file has them.
        touched: By id; nothing for those not touched.
        shoulder_mm: Where the arm's reach is counted from, (3,).
        reach_mm: How far the ball gets from there, at most.
        notes: What is not as it should be, but no reason to refuse.
        errors_unknown: Why the touches have no errors; None where they have.
        tool: With which all was touched; None where the campaign names none.
    """

    artefacts: Mapping[str, Artefact]
    touched: Mapping[str, ArtefactTouches]
    shoulder_mm: Floats
    reach_mm: float
    notes: tuple[str, ...] = ()
    occasion: Occasion = Occasion()
    errors_unknown: str | None = "the points have no angles"
    tool: Tool | None = None

    @property
    def temperature_c(self) -> Floats:
        """Known temperatures of all touches."""
        all_c = np.concatenate(
            [np.empty(0), *(t.temperature_c for t in self.touched.values())]
        )
        known_c: Floats = all_c[np.isfinite(all_c)]
        return known_c

    def of(self, name: str) -> ArtefactTouches:
        """The touches of an artefact; none where there are none."""
        empty = ArtefactTouches(np.empty((0, 3)), (), np.empty(0), np.empty(0))
        return self.touched.get(name, empty)

    def distance_share(self, places_mm: Floats) -> Floats:
        """Return how far places are from the shoulder, as parts of the reach, (n,)."""
        away_mm = np.linalg.norm(places_mm - self.shoulder_mm, axis=1)
        shares: Floats = away_mm / self.reach_mm
        return shares


def reach_of(arm: Arm) -> tuple[Floats, float]:
    """Return where the second joint is in the base posture, and how far the ball gets.

    The first joint turns the whole arm; from the second on links add up at most.
    """
    geometry = near_origins(geometry_from_arm(arm))
    links_mm = geometry.links_mm.copy()
    links_mm[-1] += geometry.probe_vector_mm
    first = min(1, len(links_mm) - 1)
    shoulder_mm = geometry.origin_mm + links_mm[:first].sum(axis=0)
    return shoulder_mm, float(np.sum(np.linalg.norm(links_mm[first:], axis=1)))


def measurement_of_touches(
    arm: Arm,
    artefacts: Mapping[str, Artefact],
    names: tuple[Sequence[str], Sequence[str]],
    numbers: Floats,
    notes: Iterable[str],
    *,
    occasion: Occasion,
    errors: JointCovariance | str = "the points have no angles",
) -> Measurement:
    """Sort n touches by artefact, with the names of artefact and feature of each.

    Numbers are the place of the ball's centre, temperature, and radius of the tip,
    (n, 5); errors those of the places, else why they are not known.
    """
    known = None if isinstance(errors, str) else errors
    every = ArtefactTouches(
        numbers[:, :3], tuple(names[1]), numbers[:, 3], numbers[:, 4], known
    )
    by_name: dict[str, list[int]] = {}
    for row, name in enumerate(names[0]):
        by_name.setdefault(name, []).append(row)
    shoulder_mm, reach_mm = reach_of(arm)
    return Measurement(
        artefacts=artefacts,
        touched={name: every.part(rows) for name, rows in by_name.items()},
        shoulder_mm=shoulder_mm,
        reach_mm=reach_mm,
        notes=tuple(notes),
        occasion=occasion,
        errors_unknown=errors if isinstance(errors, str) else None,
    )


# Part of the touches that may be second presses in one posture.
_MOST_COPIED = 0.02


def copied_touches(touched: Iterable[ArtefactTouches]) -> int | None:
    """Count touches at exactly the place of another; None: not so many that it counts.

    Noise never repeats itself.
    """
    places_mm = np.vstack([np.empty((0, 3)), *(of.places_mm for of in touched)])
    n_copied = len(places_mm) - len(np.unique(places_mm, axis=0))
    return n_copied if n_copied > _MOST_COPIED * len(places_mm) else None


class IncompleteError(ValueError):
    """A figure cannot be computed; says what is missing or too much."""


def warmer_c(artefact: Artefact, touched: ArtefactTouches) -> float:
    """Return by how much it was warmer than at its certificate.

    Raises:
        IncompleteError: It expands, and its temperature was not measured.
    """
    per_c, reference_c = artefact.expansion
    known = touched.temperature_c[np.isfinite(touched.temperature_c)]
    if len(known) == 0:
        if per_c != 0.0:
            raise IncompleteError(
                f"{artefact.id}: expansion_per_c is {per_c:g}, but the touches have no "
                "temperature_c; add that column"
            )
        return 0.0
    return float(known.mean()) - reference_c


def growth(artefact: Artefact, touched: ArtefactTouches) -> float:
    """Return by which factor its lengths had grown."""
    return 1.0 + artefact.expansion[0] * warmer_c(artefact, touched)


def certified_sphere(artefact: Artefact | None, name: str) -> Sphere:
    """Check that an artefact is a sphere of known radius, touched outside.

    Raises:
        IncompleteError: It is not.
    """
    if artefact is None:
        raise IncompleteError(f"{name}: is not among the artefacts")
    if not isinstance(artefact, Sphere):
        raise IncompleteError(f"{name}: is a {artefact.kind}, expected a sphere")
    if artefact.radius_mm is None:
        raise IncompleteError(f"{name}: radius_mm is missing; it is calibrated")
    if artefact.side != "outside":
        raise IncompleteError(f'{name}: side is "inside"; a test sphere is a ball')
    return artefact


def certified_length(artefact: Artefact) -> tuple[float, float]:
    """Say a certified length and its standard uncertainty.

    Raises:
        IncompleteError: The artefact has no single length.
    """
    if isinstance(artefact, BallBar | ParallelPlanes):
        return artefact.distance_mm, artefact.distance_std_mm or 0.0
    if isinstance(artefact, Seats) and len(artefact.known) == 1:
        return artefact.known[0].distance_mm, artefact.known[0].distance_std_mm or 0.0
    if isinstance(artefact, Points) and isinstance(artefact.points_mm, dict):
        if len(artefact.points_mm) != 2 or artefact.frame != "own":
            raise IncompleteError(
                f"{artefact.id}: has {counted(len(artefact.points_mm), 'point')}, "
                'frame = "'
                f'{artefact.frame}"; a length has two points with frame = "own"'
            )
        first, second = (np.array(place) for place in artefact.points_mm.values())
        std_mm = np.sqrt(2.0) * (artefact.points_std_mm or 0.0)
        return float(np.linalg.norm(second - first)), float(std_mm)
    raise IncompleteError(
        f"{artefact.id}: is a {artefact.kind}, which has no certified length"
    )


def identity_of(artefact: Artefact) -> str:
    """Name a standard by its serial number, else by its certified size.

    What has the same certified size is the same standard, in another place.
    """
    if artefact.serial_number:
        return f"{artefact.kind} {artefact.serial_number}"
    if isinstance(artefact, Sphere):
        return f"sphere of {artefact.radius_mm} mm"
    return f"{artefact.kind} of {certified_length(artefact)[0]} mm"


@dataclass(frozen=True, slots=True)
class FittedSphere:
    """Figures of touches on a calibrated sphere.

    Attributes:
        centre_mm: (3,)
        size_mm: Diameter less the calibrated one, which has grown with the warmth.
        off_mm: (n,) How far each touch lies outside of the fitted sphere.
        form_mm: Largest distance from the centre less the smallest.
    """

    centre_mm: Floats
    size_mm: float
    off_mm: Floats
    form_mm: float


def fitted(
    touched: ArtefactTouches, what: str, radius_mm: float | None = None
) -> fits.Sphere:
    """Fit a sphere to the places of the ball's centre.

    Raises:
        IncompleteError: The points fit no sphere.
    """
    try:
        if radius_mm is None:
            return fits.fit_sphere(touched.places_mm)
        return fits.fit_sphere_of_radius(touched.places_mm, radius_mm)
    except ValueError as error:
        raise IncompleteError(f"{what}: {error}") from error


def fitted_sphere(sphere: Sphere, touched: ArtefactTouches, what: str) -> FittedSphere:
    """Fit the touches of a calibrated sphere.

    Raises:
        IncompleteError: They fit no sphere, or its temperature is unknown.
    """
    fit = fitted(touched, what)
    calibrated_mm = 2.0 * float(sphere.radius_mm or 0.0) * growth(sphere, touched)
    size_mm = 2.0 * (fit.radius_mm - float(touched.tip_mm.mean())) - calibrated_mm
    away_mm = np.linalg.norm(touched.places_mm - fit.centre_mm, axis=1)
    return FittedSphere(
        fit.centre_mm, size_mm, away_mm - fit.radius_mm, float(np.ptp(away_mm))
    )
