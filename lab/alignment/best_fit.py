"""Best fit and leapfrog: the adjusted Helmert transformation with all it is worth.

Two lists of common points with different shapes are told why, by a unit or by exchanged
names. Neither is small: where the cause is one of these, the residuals fail every test,
and what the tests say of single points leads astray.
"""

from collections.abc import Collection, Iterator, Sequence
from itertools import combinations

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.adjustment import (
    AdjustedHelmert,
    HelmertError,
    Reliability,
    adjusted_helmert,
    point_statistics,
    reliability_of,
)
from traverse.kinematics.helmert.shape import shape_of
from traverse.kinematics.helmert.symmetry import other_orders
from traverse.kinematics.helmert.transformation import closed_helmert, mirrored_share
from traverse.kinematics.helmert.volume import Volume, disposition_index, mean_motions
from traverse.lab.alignment.nominal import VolumeFunction
from traverse.lab.alignment.result import (
    FOUND,
    POINT_LEVEL,
    WORDS,
    AlignmentResult,
    AlignmentWarning,
    Detectable,
    PointResult,
    disposition_flags,
    global_test,
    point_p_value,
    revealed_flags,
    scale_flags,
    scatter_flags,
    turn_problem,
)
from traverse.lab.alignment.touches import CommonPoints, Place, places_mm

_MIRRORED = 0.1


def best_fit_alignment(
    common: CommonPoints,
    volume_of: VolumeFunction,
    volume_source: str,
    *,
    method: str = "best-fit",
    with_scale: bool = False,
    radii_mm: Collection[float] = (),
    remarks: Sequence[str] = (),
) -> AlignmentResult:
    """Adjust the transformation (with a scale: seven parameters); say what it is worth.

    ``radii_mm`` are those of the balls whose centres are the measured places.

    Raises:
        HelmertError: The points do not determine it; says what is left open.
        ValueError: Errors are stated of some points only.
    """
    from_mm, to_mm = places_mm(common.measured), places_mm(common.nominal)
    from_covariance, to_covariance, is_stated = _errors(common)
    covariances_mm2 = from_covariance + to_covariance if is_stated else None
    adjusted = adjusted_helmert(
        from_mm,
        to_mm,
        from_covariance,
        to_covariance,
        from_shared_mm=_shared_mm(common.measured),
        to_shared_mm=_shared_mm(common.nominal),
        with_scale=with_scale,
    )
    if mirrored_share(from_mm, to_mm) < _MIRRORED:
        raise HelmertError(
            "the points fit the mirror image of the nominal ones far better than "
            "these: a system is left-handed, a sign of a coordinate is wrong, or names "
            "are exchanged"
        )
    test = global_test(
        adjusted.sum_of_squares, adjusted.redundancy, is_stated=is_stated
    )
    sigma0 = 1.0 if test is None else test.sigma0
    # Stated errors are trusted until a test says that they are too small.
    trusted = is_stated and (test is None or test.passed)
    variance_factor = 1.0 if trusted else sigma0**2
    covariance = variance_factor * adjusted.cofactors
    shape = shape_of(to_mm)
    disagreement: list[AlignmentWarning] = []
    if test is not None and not test.passed:
        disagreement = list(disagreements(common.names, from_mm, to_mm))
    problem = turn_problem(covariance, shape)
    if problem is not None:
        raise HelmertError(disagreement[0].text if disagreement else problem)
    volume = volume_of(adjusted.transformation)
    index = disposition_index(to_mm, volume, with_scale=with_scale)
    points = _points(common, adjusted, volume, None if is_stated else sigma0)
    flags = [
        *disposition_flags(shape, index),
        *scatter_flags(common),
        *scale_flags(adjusted.transformation.scale),
        *disagreement,
        *_different_balls(radii_mm),
        *_already_there(from_mm, to_mm),
        *_symmetric(common.names, to_mm, adjusted, covariances_mm2),
        *revealed_flags(test, points, is_stated=is_stated),
        *_suspects(points, is_stated=is_stated),
    ]
    return AlignmentResult(
        method=method,
        transformation=adjusted.transformation,
        centre_mm=adjusted.centre_mm,
        covariance=covariance,
        is_stated=is_stated,
        points=points,
        test=test,
        volume=volume,
        volume_source=volume_source,
        index=index,
        flags=tuple(flags),
        remarks=tuple(remarks),
    )


def _shared_mm(places: Sequence[Place]) -> Floats | None:
    """Factors of what places share, (n, 3, rank); None where it is not known of all."""
    known = [
        p.shared_mm for p in places if p.shared_mm is not None and p.shared_mm.size
    ]
    return np.array(known) if len(known) == len(places) else None


def _errors(common: CommonPoints) -> tuple[Floats, Floats, bool]:
    """List the covariances of both sides; alike where nothing is stated at all.

    Raises:
        ValueError: They are stated of some only.
    """
    n, none = len(common.names), np.zeros((3, 3))
    measured, nominal = (
        [place.covariance_mm2 for place in places]
        for places in (common.measured, common.nominal)
    )
    lacking = [
        name for name, c in zip(common.names, measured, strict=True) if c is None
    ]
    to_covariance = np.array([none if c is None else c for c in nominal])
    if len(lacking) == n and not np.any(to_covariance):
        return np.tile(none, (n, 1, 1)), np.tile(np.eye(3), (n, 1, 1)), False
    if lacking:
        raise ValueError(
            f"errors are stated, but not of these measured points: "
            f"{', '.join(lacking)}; state them for all with --std"
        )
    from_covariance = np.array(measured, dtype=np.float64)
    return from_covariance.reshape(n, 3, 3), to_covariance.reshape(n, 3, 3), True


def _points(
    common: CommonPoints,
    adjusted: AdjustedHelmert,
    volume: Volume,
    unit_mm: float | None,
) -> tuple[PointResult, ...]:
    """Compute for every point the effect of an undetected error, and test the point.

    The unit is the standard deviation of a coordinate where none are stated.
    """
    sigma0 = 1.0 if unit_mm is None else unit_mm
    reliability = reliability_of(adjusted)
    statistics = point_statistics(adjusted, reliability)
    mean = mean_motions(volume, adjusted.centre_mm, len(adjusted.cofactors))
    return tuple(
        PointResult(
            name=name,
            nominal_mm=common.nominal[row].place_mm,
            residual_mm=adjusted.misclosures_mm[row],
            residual_length_mm=float(np.linalg.norm(adjusted.misclosures_mm[row])),
            touches=common.measured[row].touches,
            spread_mm=common.measured[row].spread_mm,
            redundancy=reliability.shares[row],
            detectable_mm=_detectable(reliability.seen_per_mm2[row], sigma0),
            worst_direction=_towards_positive(reliability.directions[row, 0]),
            hidden_in_volume_mm=_hidden_mm(reliability, row, mean, sigma0),
            hidden_in_volume_per_mm=_hidden_ratio(reliability, row, mean),
            p_value=point_p_value(
                float(statistics[row]),
                int(np.count_nonzero(reliability.seen_per_mm2[row])),
            )
            if unit_mm is None
            else None,
        )
        for row, name in enumerate(common.names)
    )


def _towards_positive(direction: Floats) -> Floats:
    """Turn a direction, of which both senses are alike, the same way each time."""
    largest = np.flatnonzero(np.abs(direction) > 0.99 * np.max(np.abs(direction)))[0]
    turned: Floats = direction * np.sign(direction[largest])
    return turned


def _detectable(seen_per_mm2: Floats, sigma0: float) -> Detectable:
    best, worst = (
        sigma0 * FOUND / float(np.sqrt(seen)) if seen > 0.0 else None
        for seen in (seen_per_mm2[-1], seen_per_mm2[0])
    )
    return Detectable(best, worst)


def _hidden_mm(
    reliability: Reliability, row: int, mean: Floats, sigma0: float
) -> float | None:
    """Maximise e'G e over e'B e = FOUND^2, G what an error does to the volume."""
    seen = reliability.seen_per_mm2[row]
    if not seen[0] > 0.0:
        return None
    scaled = reliability.moves[row] @ reliability.directions[row].T / np.sqrt(seen)
    largest = float(np.linalg.eigvalsh(scaled.T @ mean @ scaled)[-1])
    return sigma0 * FOUND * float(np.sqrt(max(largest, 0.0)))


def _hidden_ratio(reliability: Reliability, row: int, mean: Floats) -> float:
    """Return what an error in the worst direction does to the volume, per mm."""
    moves = reliability.moves[row] @ reliability.directions[row, 0]
    return float(np.sqrt(max(float(moves @ mean @ moves), 0.0)))


def _suspects(
    points: Sequence[PointResult], *, is_stated: bool
) -> list[AlignmentWarning]:
    """Name the point whose residuals are outliers, if any."""
    tested = [p for p in points if p.p_value is not None]
    if not is_stated or not tested:
        return []
    worst = min(tested, key=lambda point: point.p_value or 0.0)
    if not (worst.p_value or 0.0) < POINT_LEVEL:
        return []
    return [AlignmentWarning("suspect_point", WORDS.suspect_point(worst))]


_SAME_BALL_MM = 0.01


def _different_balls(radii_mm: Collection[float]) -> Iterator[AlignmentWarning]:
    """Flag centres of different balls: in a seat each is at a place of its own."""
    if radii_mm and max(radii_mm) - min(radii_mm) > _SAME_BALL_MM:
        text = WORDS.different_balls(min(radii_mm), max(radii_mm))
        yield AlignmentWarning("different_balls", text)


_ALREADY_THERE = 1e-3  # of the points' mean distance from their middle


def _already_there(from_mm: Floats, to_mm: Floats) -> Iterator[AlignmentWarning]:
    """Flag points that were aligned before they came here.

    Where the arm stands its own origin is: no part's system has the same.
    """
    away_mm = np.linalg.norm(from_mm - to_mm, axis=1).max()
    size_mm = np.linalg.norm(to_mm - to_mm.mean(axis=0), axis=1).mean()
    if away_mm < _ALREADY_THERE * size_mm:
        yield AlignmentWarning("already_aligned", WORDS.already_aligned(away_mm))


def _symmetric(
    names: Sequence[str],
    to_mm: Floats,
    adjusted: AdjustedHelmert,
    covariances_mm2: Floats | None,
) -> Iterator[AlignmentWarning]:
    """Flag points that fit as well in another order: nothing shows the right one."""
    error_mm2 = np.sum(adjusted.misclosures_mm**2, axis=1)
    if covariances_mm2 is not None:
        error_mm2 = np.trace(covariances_mm2, axis1=1, axis2=2)
    orders = other_orders(to_mm, float(np.sqrt(np.mean(error_mm2))))
    if orders:
        exchanged = [
            (names[row], names[place])
            for row, place in enumerate(orders[0].order.tolist())
            if row != place
        ]
        turn_degrees = float(np.degrees(orders[0].turn_rad))
        text = WORDS.symmetric(exchanged, len(orders), turn_degrees)
        yield AlignmentWarning("symmetric", text)


_UNITS = {"metres": 1000.0, "inches": 25.4, "centimetres": 10.0, "feet": 304.8}
_SAME_UNIT = 0.02  # of the ratio
_OTHER_SIZE = 2.0
_EXPLAINED = 0.01  # of the sum of squares remains
_MOST_POINTS = 60


def disagreements(
    names: Sequence[str], from_mm: Floats, to_mm: Floats
) -> Iterator[AlignmentWarning]:
    """Name the causes that explain the residuals, if any.

    Args:
        names: Of the common points, (n,).
        from_mm: As measured, (n, 3).
        to_mm: Nominal, (n, 3).
    """
    weights = np.ones(len(names))
    scale = closed_helmert(from_mm, to_mm, weights, with_scale=True).scale
    units = [
        (unit, side)
        for unit, length_mm in _UNITS.items()
        for side, ratio in (("measured", scale), ("nominal", 1.0 / scale))
        if abs(ratio / length_mm - 1.0) < _SAME_UNIT
    ]
    if units or not 1.0 / _OTHER_SIZE < scale < _OTHER_SIZE:
        text = WORDS.other_size(1.0 / scale, units[0] if units else None)
        yield AlignmentWarning("other_size", text)
        return
    pair = _exchanged(from_mm, to_mm)
    if pair is not None:
        text = WORDS.exchanged_names(*(names[row] for row in pair))
        yield AlignmentWarning("exchanged_names", text)


def _exchanged(from_mm: Floats, to_mm: Floats) -> tuple[int, int] | None:
    """Find the two points whose exchange explains the residuals."""
    n = len(from_mm)
    if n > _MOST_POINTS:
        return None
    before_mm2 = _squares_mm2(from_mm, to_mm)
    exchanges = list(combinations(range(n), 2))
    after_mm2 = []
    for first, second in exchanges:
        order = np.arange(n)
        order[[first, second]] = second, first
        after_mm2.append(_squares_mm2(from_mm[order], to_mm))
    best = int(np.argmin(after_mm2))
    others = np.delete(after_mm2, best)
    explains = after_mm2[best] < _EXPLAINED * min(before_mm2, *others)
    return exchanges[best] if explains else None


def _squares_mm2(from_mm: Floats, to_mm: Floats) -> float:
    fit = closed_helmert(from_mm, to_mm, np.ones(len(to_mm)), with_scale=False)
    return float(np.sum((to_mm - fit.places_mm(from_mm)) ** 2))
