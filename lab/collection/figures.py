"""Running figures of a collection: how well touches agree, where the joints have been.

Computed from the coordinates that the daemon sent, so with the arm file it has: they
show a bad touch at once, they are no identification.
"""

from collections.abc import Sequence

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.kinematics.fits import (
    PLAUSIBLE_MM,
    fit_sphere,
    off_seat,
    off_sphere,
    spread_about_mean,
)
from traverse.lab.artefacts.ball_bar import BallBar
from traverse.lab.collection.collection import CollectedTouch, Collection

SECTORS = 36
_HEIGHTS = " ▁▂▃▄▅▆▇█"


def agreement(collection: Collection, artefact: str, kind: str) -> str:
    """How well the touches of an artefact agree so far; empty if unknown."""
    touches = collection.of(artefact)
    by_feature: dict[str, list[CollectedTouch]] = {}
    for touch in touches:
        by_feature.setdefault(touch.feature, []).append(touch)
    try:
        match kind:
            case "cone":
                spread = spread_about_mean(_places(touches))
                return (
                    f"{spread.max_deviation_mm:.4f} mm at most from the mean, rms "
                    f"{spread.rms_mm:.4f} mm"
                )
            case "sphere":
                sphere = fit_sphere(_places(touches))
                return f"radius {sphere.radius_mm:.4f} mm, rms {sphere.rms_mm:.4f} mm"
            case "ball_bar":
                first, second = (fit_sphere(_places(by_feature[f])) for f in "12")
                apart_mm = np.linalg.norm(first.centre_mm - second.centre_mm)
                worse_mm = max(first.rms_mm, second.rms_mm)
                (bar,) = (a for a in collection.file.artefacts if a.id == artefact)
                known_mm = bar.distance_mm if isinstance(bar, BallBar) else np.nan
                return (
                    f"distance {apart_mm:.4f} mm (known {known_mm:g}), "
                    f"rms {worse_mm:.4f} mm"
                )
            case "plane" | "parallel_planes":
                rms_mm = max(
                    _flatness(_places(of_feature)) for of_feature in by_feature.values()
                )
                return f"flat within rms {rms_mm:.4f} mm"
            case _:
                repeated = [
                    of_feature
                    for of_feature in by_feature.values()
                    if len(of_feature) > 1
                ]
                worst = max(
                    spread_about_mean(_places(of_feature)).max_deviation_mm
                    for of_feature in repeated
                )
                return f"repeats within {worst:.4f} mm"
    except (ValueError, KeyError):
        return ""  # too few touches for a figure


def same_place(collection: Collection, touch: CollectedTouch) -> list[CollectedTouch]:
    """The touches that must be where a touch is: of its seat, sphere or face."""
    target = collection.target(touch.artefact, touch.feature)
    is_seat = target is not None and target.kind == "cone"  # whatever its features
    return collection.of(touch.artefact, None if is_seat else touch.feature)


def implausible_mm(
    collection: Collection, touch: CollectedTouch, tip_mm: float
) -> float | None:
    """How far a touch is off the others of its place; None where it can be of it.

    Points counted in by the user are trusted: an arm that is not yet identified may be
    that coarse, and twice as far is then plausible.
    """
    (artefact,) = (a for a in collection.file.artefacts if a.id == touch.artefact)
    others_mm = _places(same_place(collection, touch)).reshape(-1, 3)
    radius_mm = getattr(artefact, "radius_mm", None)

    def off(places_mm: Floats) -> Floats:
        match artefact.kind:
            case "plane" | "parallel_planes":
                return np.zeros(len(places_mm))  # a face may be of any size
            case "sphere" | "ball_bar":
                widest_mm = None if radius_mm is None else 2.0 * (radius_mm + tip_mm)
                return off_sphere(places_mm, others_mm, widest_mm)
            case _:
                return off_seat(places_mm, others_mm)

    off_mm = float(off(_places([touch]))[0])
    believed_mm = 2.0 * float(off(others_mm).max(initial=0.0))
    return off_mm if off_mm > max(PLAUSIBLE_MM, believed_mm) else None


def coverage(touches: Sequence[CollectedTouch], n_joints: int) -> Integers:
    """Touches in each of 36 sectors of a turn from reading 0 on, (n_joints, 36)."""
    counts = np.zeros((n_joints, SECTORS), dtype=np.int64)
    for touch in touches:
        turns = np.mod(np.array(touch.angles_rad) / (2.0 * np.pi), 1.0)
        sectors = np.minimum((turns * SECTORS).astype(np.int64), SECTORS - 1)
        counts[np.arange(n_joints), sectors] += 1
    return counts


def picture(counts: Integers) -> str:
    """One joint's sectors (36,) as a row of blocks, the fullest one highest."""
    largest = max(1, int(counts.max()))
    heights = -(-counts * (len(_HEIGHTS) - 1) // largest)
    return "".join(_HEIGHTS[height] for height in heights.tolist())


def _places(touches: Sequence[CollectedTouch]) -> Floats:
    return np.array([touch.xyz_mm for touch in touches], dtype=np.float64)


def _flatness(places_mm: Floats) -> float:
    """Root mean square distance from the best plane."""
    if len(places_mm) < 4:
        raise ValueError("three points are always in a plane")
    singular = np.linalg.svd(places_mm - places_mm.mean(axis=0), compute_uv=False)
    return float(singular[-1] / np.sqrt(len(places_mm)))
