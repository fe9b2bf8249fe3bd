"""What the certificates of artefacts say, as acceptance needs it."""

import numpy as np

from traverse.lab.artefacts import Artefact
from traverse.lab.artefacts.ball_bar import BallBar
from traverse.lab.artefacts.parallel_planes import ParallelPlanes
from traverse.lab.artefacts.points import Points
from traverse.lab.artefacts.sphere import Sphere
from traverse.lab.measured_points.measurement import ArtefactTouches


class IncompleteError(ValueError):
    """A figure cannot be computed; says what is missing or too much."""


def warmer_c(artefact: Artefact, touched: ArtefactTouches) -> float:
    """Say by how much it was warmer than at its certificate.

    Raises:
        IncompleteError: It expands, and nobody measured how warm it was.
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
    """Say by which factor its lengths had grown."""
    return 1.0 + artefact.expansion[0] * warmer_c(artefact, touched)


def certified_sphere(artefact: Artefact | None, name: str) -> Sphere:
    """Take an artefact that must be a sphere of known radius, touched outside.

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
    if isinstance(artefact, Points) and isinstance(artefact.points_mm, dict):
        if len(artefact.points_mm) != 2 or artefact.frame != "own":
            raise IncompleteError(
                f'{artefact.id}: has {len(artefact.points_mm)} points, frame = "'
                f'{artefact.frame}"; a length has two points with frame = "own"'
            )
        first, second = (np.array(at) for at in artefact.points_mm.values())
        std_mm = np.sqrt(2.0) * (artefact.points_std_mm or 0.0)
        return float(np.linalg.norm(second - first)), float(std_mm)
    raise IncompleteError(
        f"{artefact.id}: is a {artefact.kind}, which has no certified length"
    )
