"""Measured lengths: from the touches of a standard to errors of length.

    ball bar          |c_2 - c_1|, centres of spheres of the calibrated radius, fitted
                      to at least four points each: unidirectional
    two seats         |x_2 - x_1|, the ball sits in a cone: unidirectional
    parallel planes   distance of two planes with a common normal, fitted to at least
                      three points each, less twice the tip's radius: bidirectional

    E = L_measured - L_certified (1 + a (T - T_ref))

A repeat of a bar or a pair of planes is a run of touches of one end, then one of the
other, in the order of time; of two seats the r-th touches of both belong together.
"""

from collections.abc import Sequence
from itertools import chain

import numpy as np

from traverse.arrays import Floats
from traverse.lab.acceptance.budget import (
    Budget,
    CertifiedValue,
    Contribution,
    form_factor,
    length_budget,
    repeatability,
)
from traverse.lab.acceptance.conformity import LengthError, Missing, Part
from traverse.lab.acceptance.limits import Limits
from traverse.lab.acceptance.monte_carlo import Model, Reduction
from traverse.lab.artefacts import Artefact
from traverse.lab.artefacts.ball_bar import BallBar
from traverse.lab.artefacts.plane import ParallelPlanes
from traverse.lab.measured_points.measurement import (
    SCANNED,
    ArtefactTouches,
    IncompleteError,
    Measurement,
    certified_length,
    fitted,
    growth,
    identity_of,
    warmer_c,
)
from traverse.plurals import counted

_LEAST_PER_PLANE = 3
LEAST_OF_SCAN = 25  # of a ball or a face
SET = 3


def refuse_few(touched: ArtefactTouches, what: str, least: int) -> None:
    """Refuse fewer touches.

    Raises:
        IncompleteError: There are fewer.
    """
    if len(touched) < least:
        raise IncompleteError(
            f"{what}: {counted(len(touched), 'point')}, expected at least {least}"
        )


def errors_of(
    measured: Measurement, name: str, key: str, limits: Limits
) -> list[LengthError]:
    """Measure all repeats of a length.

    Raises:
        IncompleteError: Something is missing or does not fit.
    """
    artefact = measured.artefacts.get(name)
    if artefact is None:
        raise IncompleteError(f"{name}: is not among the artefacts")
    if len(measured.of(name)) == 0:
        raise IncompleteError(f"{name}: was not measured")
    length_mm, _ = certified_length(artefact)
    limit = limits.mpe.of(key)
    errors = []
    for number, (first, second) in enumerate(
        repeats_of(artefact, measured.of(name)), 1
    ):
        where = f"{name} repeat {number}"
        if name.startswith(SCANNED):
            for end in (first, second):
                refuse_few(end, f"{where} on {end.features[0]}", LEAST_OF_SCAN)
        both = joined(first, second)
        measured_mm, form_factor = _measured_mm(artefact, first, second, where)
        error_mm = measured_mm - length_mm * growth(artefact, both)
        errors.append(
            LengthError(
                name,
                number,
                length_mm,
                error_mm,
                None if limit is None else limit.at(length_mm),
                _budget_of(artefact, both, limits, form_factor),
                "set" if number <= SET else "repeat",
            )
        )
    return errors


def _budget_of(
    artefact: Artefact,
    touched: ArtefactTouches,
    limits: Limits,
    form_factor: float | None,
) -> Budget:
    length_mm, std_mm = certified_length(artefact)
    value = CertifiedValue(
        identity_of(artefact),
        length_mm,
        std_mm,
        artefact.stated_expansion,
        warmer_c(artefact, touched),
        form_factor,
    )
    return length_budget(value, limits.standards)


def repeats_of(
    artefact: Artefact, touched: ArtefactTouches
) -> list[tuple[ArtefactTouches, ArtefactTouches]]:
    """Take repeats: the touches of both ends.

    Raises:
        IncompleteError: An end is missing.
    """
    names = tuple(artefact.features)
    if artefact.rows_per_pose == 3:
        ends = [touched.of(name) for name in names]
        if len(ends[0]) != len(ends[1]):
            raise IncompleteError(
                f"{artefact.id}: seat {names[0]} was touched "
                f"{counted(len(ends[0]), 'time')}, "
                f"seat {names[1]} {counted(len(ends[1]), 'time')}; expected as often"
            )
        return [
            (ends[0].part([row]), ends[1].part([row])) for row in range(len(ends[0]))
        ]
    runs = touched.runs()
    if len(runs) % 2:
        raise IncompleteError(
            f"{artefact.id}: {counted(len(runs), 'run')} of touches, ending with "
            "feature "
            f"{runs[-1].features[0]}; expected one of each feature in every repeat"
        )
    pairs = []
    for first, second in zip(runs[::2], runs[1::2], strict=True):
        swapped = first.features[0] != names[0]
        pairs.append((second, first) if swapped else (first, second))
    return pairs


def _measured_mm(
    artefact: Artefact, first: ArtefactTouches, second: ArtefactTouches, where: str
) -> tuple[float, float | None]:
    """Measure a length; also say how far the form of touched balls moves it."""
    if isinstance(artefact, BallBar):
        return _between_balls_mm(artefact, first, second, where)
    if isinstance(artefact, ParallelPlanes):
        return _between_planes_mm(artefact, first, second, where), None
    return float(np.linalg.norm(second.places_mm[0] - first.places_mm[0])), None


def _between_balls_mm(
    bar: BallBar, first: ArtefactTouches, second: ArtefactTouches, where: str
) -> tuple[float, float]:
    centres_mm, spreads = [], []
    for number, part in enumerate((first, second)):
        around_mm = float(bar.radii_mm[number] * growth(bar, part) + part.tip_mm.mean())
        ball = f"{where} sphere {number + 1}"
        centre_mm = fitted(part, ball, around_mm).centre_mm
        normals = (part.places_mm - centre_mm) / around_mm
        centres_mm.append(centre_mm)
        spreads.append(np.linalg.pinv(normals.T @ normals))
    between_mm = centres_mm[1] - centres_mm[0]
    length_mm = float(np.linalg.norm(between_mm))
    way = between_mm / length_mm
    of_touch = float(np.sqrt(sum(way @ spread @ way for spread in spreads)))
    return length_mm, form_factor(of_touch)


def _between_planes_mm(
    artefact: ParallelPlanes,
    first: ArtefactTouches,
    second: ArtefactTouches,
    where: str,
) -> float:
    for part in (first, second):
        refuse_few(part, f"{where} on face {part.features[0]}", _LEAST_PER_PLANE)
    try:
        normal = face_normal(first, second)
    except ValueError as error:
        raise IncompleteError(f"{where}: {error}") from error
    between_mm = second.places_mm.mean(axis=0) - first.places_mm.mean(axis=0)
    apart_mm = abs(float(between_mm @ normal))
    tip_mm = float(np.concatenate([first.tip_mm, second.tip_mm]).mean())
    return (
        apart_mm - 2.0 * tip_mm
        if artefact.side == "outside"
        else (apart_mm + 2.0 * tip_mm)
    )


def face_normal(first: ArtefactTouches, second: ArtefactTouches) -> Floats:
    """Fit a common normal, (3,): the direction in which both faces scatter least.

    Raises:
        ValueError: The points determine none.
    """
    parts = [part.places_mm - part.places_mm.mean(axis=0) for part in (first, second)]
    _, sizes, rows = np.linalg.svd(np.concatenate(parts))
    if not sizes[1] > 1e-6 * sizes[0]:
        raise ValueError("the points of the faces lie on lines")
    normal: Floats = rows[2]
    return normal


def joined(first: ArtefactTouches, second: ArtefactTouches) -> ArtefactTouches:
    """Put the touches of both ends together."""
    errors = None
    if first.errors is not None and second.errors is not None:
        errors = first.errors.joined(second.errors)
    return ArtefactTouches(
        np.concatenate([first.places_mm, second.places_mm]),
        (*first.features, *second.features),
        np.concatenate([first.temperature_c, second.temperature_c]),
        np.concatenate([first.tip_mm, second.tip_mm]),
        errors,
    )


def length_sets(
    measured: Measurement,
    names: Sequence[str],
    key: str,
    limits: Limits,
    times: dict[int, str],
    *,
    title: str,
) -> tuple[list[list[LengthError]], Sequence[Part]]:
    """Measure lengths.

    The times say how often each may have been measured, with the words for it.

    Returns:
        The errors by artefact, and all of them; where anything is missing none, and
        what is missing under the figure's title.
    """
    sets: list[list[LengthError]] = []
    problems: list[str] = []
    for name in names:
        try:
            errors = errors_of(measured, name, key, limits)
            if len(errors) not in times:
                raise IncompleteError(
                    f"{name}: was measured {counted(len(errors), 'time')}, expected "
                    f"{', or '.join(times.values())}"
                )
        except IncompleteError as error:
            problems.append(str(error))
            continue
        sets.append(errors)
    if problems:
        return [], [Missing(title, tuple(problems))]
    return sets, list(chain.from_iterable(sets))


def largest_of(errors: Sequence[LengthError]) -> LengthError:
    """Take the error of the largest size, as a part of its limit if it has one."""
    return max(errors, key=lambda error: abs(error.error_mm) / (error.limit_mm or 1.0))


def model_of(errors: Sequence[LengthError], reduction: Reduction = "largest") -> Model:
    """Say that a figure is made of these errors."""
    values_mm = np.array([error.error_mm for error in errors])
    return Model(values_mm, [error.budget for error in errors], reduction)


def repeatability_of(sets: Sequence[Sequence[LengthError]]) -> Contribution:
    """Pool the scatter of each length's repeats in its place."""
    values_mm = np.array([[error.error_mm for error in errors] for errors in sets])
    degrees = values_mm.shape[0] * (values_mm.shape[1] - 1)
    return repeatability(
        "repeatability of the arm",
        f"pooled of {values_mm.shape[0]} x {values_mm.shape[1]} repeats",
        float(np.sqrt(values_mm.var(axis=1, ddof=1).mean())),
        degrees,
    )
