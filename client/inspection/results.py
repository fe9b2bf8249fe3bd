"""From points and a plan to the figures of a part."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats
from traverse.client.inspection.plan import (
    FeatureEntry,
    Plan,
    RelationEntry,
    ToleranceEntry,
)
from traverse.client.inspection.scan_samples import Sample, scan_parts
from traverse.client.inspection.values import (
    FeatureResult,
    FigureResult,
    Inspection,
    TouchResult,
)
from traverse.kinematics.features.figures import (
    Conformity,
    Figure,
    angle,
    distance,
    figures_of,
)
from traverse.kinematics.features.measured import (
    Definition,
    Features,
    Touches,
    measured_features,
)
from traverse.kinematics.features.relations import related
from traverse.kinematics.fits.elements import Element
from traverse.kinematics.helmert.shape import shape_of, undetermined
from traverse.kinematics.helmert.transformation import Helmert, closed_helmert
from traverse.kinematics.uncertainty.joint_covariance import (
    JointCovariance,
    covariances_of,
)
from traverse.plurals import counted
from traverse.protocol.messages import Point

MEASURED_SIDES = {"pretouch", "pulled", "inside", "outside"}
"""Compensations that know the direction to the material."""
_OF_ARM = Helmert(np.eye(3), np.zeros(3))
_ALIGNED_MM = 1e-6  # part coordinates are those of one alignment
_BETWEEN = {"distance": distance, "angle": angle}


def inspected(
    plan: Plan,
    points: Sequence[Point],
    shared_mm: Mapping[str, Floats] | str,
    alignment: Helmert | None = None,
) -> Inspection:
    """Compute all figures of a plan.

    Args:
        plan: with features, relations, tolerances.
        points: not retracted; points of no feature are left out.
        shared_mm: factors S of common errors by the arm, (3, rank), by points' ids;
            or why they are not known.
        alignment: into the part's system; None: the points', if they have one.
    """
    assigned = assigned_points(plan, points)
    measured = _measured(plan, assigned, shared_mm, alignment)
    features, unknown, every = measured.features, measured.unknown, measured.points
    is_of_part = measured.system is not None
    judge = _Judge(plan, assigned, is_known=not unknown, is_of_part=is_of_part)
    centres_mm = {
        point.id: tuple(centre_mm)
        for point, centre_mm in zip(
            every, features.errors.points_mm.tolist(), strict=True
        )
    }
    results = [
        _feature(entry, assigned[entry.name], centres_mm, features, judge)
        for entry in plan.features
    ]
    results += [_relation(entry, features, judge) for entry in plan.relations]
    return Inspection(
        plan.part,
        plan.serial,
        plan.operator,
        arm=every[0].arm if every else "",
        model=every[0].model if every else "",
        system="part" if is_of_part else "arm",
        tip_mm=measured.tip_mm,
        last_ns=max((point.time_ns for point in every), default=0),
        uncertainty_unknown=unknown,
        left_out=tuple(left_out(plan, is_of_part=is_of_part)),
        features=tuple(results),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """Features of points in a system; `unknown` says why there is no U."""

    features: Features
    points: list[Point]
    system: Helmert | None
    tip_mm: float
    unknown: str


def _measured(
    plan: Plan,
    assigned: Mapping[str, list[Point]],
    shared_mm: Mapping[str, Floats] | str,
    alignment: Helmert | None,
) -> _Measured:
    used = {point.id: point for each in assigned.values() for point in each}
    rows = {point_id: row for row, point_id in enumerate(used)}
    every = list(used.values())
    errors, system, unknown = _errors(every, shared_mm, alignment)
    tips = {point.probe_radius_mm for point in every}
    if len(tips) > 1:
        unknown = unknown or "the points were taken with balls of different radius"
    definitions = [
        Definition(
            feature.name,
            feature.kind,
            tuple(rows[point.id] for point in assigned[feature.name]),
            feature.side,
            feature.plane,
        )
        for feature in plan.features
        if assigned[feature.name]
    ]
    tip_mm = max(tips, default=0.0)
    scan_of = [p.part.scan if isinstance(p, Sample) else "" for p in every]
    scans = sorted({"", *scan_of})
    touches = Touches(
        errors,
        tip_mm,
        plan.ball_radius_std_mm or 0.0,
        _towards(every, system),
        np.array([p.compensation in MEASURED_SIDES for p in every], dtype=bool),
        np.array([scans.index(scan) - 1 for scan in scan_of], dtype=np.int64),
        np.array([point.time_ns for point in every], dtype=np.int64),
    )
    features = measured_features(definitions, touches)
    return _Measured(features, every, system, tip_mm, unknown)


def features_of_arm(
    plan: Plan, points: Sequence[Point], shared_mm: Mapping[str, Floats] | str
) -> tuple[Features, bool]:
    """Compute features and what relations make, as touched, in the arm's system.

    Returns:
        The features, and whether their errors are known.
    """
    assigned = assigned_points(plan, points)
    measured = _measured(plan, assigned, shared_mm, _OF_ARM)
    is_known = not measured.unknown
    judge = _Judge(plan, assigned, is_known=is_known, is_of_part=False)
    for entry in plan.relations:
        _relation(entry, measured.features, judge)
    return measured.features, is_known


def assigned_points(plan: Plan, points: Sequence[Point]) -> dict[str, list[Point]]:
    """Return the points of each feature: those that are listed, else by label."""
    by_id = {point.id: point for point in points}
    return {
        feature.name: (
            [point for point in points if point.label.feature == feature.name]
            if feature.points is None
            else [by_id[point_id] for point_id in feature.points if point_id in by_id]
        )
        for feature in plan.features
    }


def _errors(
    points: Sequence[Point],
    shared_mm: Mapping[str, Floats] | str,
    alignment: Helmert | None,
) -> tuple[JointCovariance, Helmert | None, str]:
    """Return the joint covariance, the alignment, and why U is not known."""
    n, unknown = len(points), shared_mm if isinstance(shared_mm, str) else ""
    tensors = np.zeros((n, 6))
    shared: list[Floats] = [np.zeros((3, 0))] * n
    if not unknown and not isinstance(shared_mm, str):
        lacking = [
            p for p in points if p.covariance_mm2 is None or p.id not in shared_mm
        ]
        ranks = {shared_mm[p.id].shape[1] for p in points if p.id in shared_mm}
        if lacking:
            of = counted(len(lacking), "point")
            unknown = f"{of} have no covariance that they share with the others"
        elif len({point.model for point in points}) > 1 or len(ranks) > 1:
            unknown = "the points were taken with different arm files or probes"
        elif ranks == {0}:
            unknown = "the arm file has no covariance: what points share is not known"
        else:
            shared = [shared_mm[point.id] for point in points]
            tensors = np.array([point.covariance_mm2 for point in points])
            tensors = tensors.reshape(n, 6)
    places_mm = np.array([point.xyz_mm for point in points]).reshape(n, 3)
    factors = np.array(shared).reshape(n, 3, -1) if n else np.zeros((0, 3, 0))
    errors = JointCovariance(places_mm, covariances_of(tensors), factors)
    alignment = alignment or alignment_of(points)
    if alignment is None:
        return errors, None, unknown
    turn = alignment.scale * alignment.rotation
    aligned = JointCovariance(
        alignment.places_mm(places_mm),
        turn @ errors.covariances_mm2 @ turn.T,
        turn @ errors.shared_mm,
    )
    return aligned, alignment, unknown


def alignment_of(points: Sequence[Point]) -> Helmert | None:
    """Return the alignment that all points have in common; None without."""
    places_mm = np.array([point.xyz_mm for point in points]).reshape(-1, 3)
    part_points_mm = [
        point.part_xyz_mm for point in points if point.part_xyz_mm is not None
    ]
    if len(part_points_mm) < max(len(points), 3):
        return None
    part_mm = np.array(part_points_mm)
    if undetermined(shape_of(places_mm)) is not None:
        return None
    alignment = closed_helmert(
        places_mm, part_mm, np.ones(len(points)), with_scale=True
    )
    off_mm = np.abs(alignment.places_mm(places_mm) - part_mm).max()
    return alignment if off_mm < _ALIGNED_MM else None


def _towards(points: Sequence[Point], alignment: Helmert | None) -> Floats:
    towards = np.array([_material(point) for point in points]).reshape(-1, 3)
    return towards if alignment is None else towards @ alignment.rotation.T


def _material(point: Point) -> Floats:
    """Return the direction to the material, else of the shank."""
    if point.compensation in MEASURED_SIDES and point.surface_mm is not None:
        way_mm = np.subtract(point.surface_mm, point.xyz_mm)
        length_mm = float(np.linalg.norm(way_mm))
        if length_mm > 0.0:
            return np.asarray(way_mm / length_mm)
    return np.array(point.ijk)


def left_out(plan: Plan, *, is_of_part: bool) -> Iterator[str]:
    """Say which errors U leaves out, and which to state so that figures are judged."""
    if plan.ball_radius_std_mm is None:
        yield (
            "U leaves out the ball's radius: state its standard uncertainty "
            "(ball_radius_std_mm; on the page: Conditions); lengths are not judged"
        )
    if plan.part_temperature is None:
        yield (
            "U leaves out the part's temperature: state it and the expansion "
            "(part_temperature; on the page: Conditions); lengths are not judged"
        )
    if is_of_part:
        yield (
            "U of coordinates leaves out the alignment; they are not judged, "
            "distances are"
        )


class _Judge:
    """Decides on figures, as far as their uncertainty and their points allow."""

    def __init__(
        self,
        plan: Plan,
        assigned: Mapping[str, list[Point]],
        *,
        is_known: bool,
        is_of_part: bool,
    ) -> None:
        self._is_known = is_known
        self._is_of_part = is_of_part
        of_part = plan.part_temperature
        self._expansion = None if of_part is None else of_part.expansion
        self._judges_lengths = None not in (of_part, plan.ball_radius_std_mm)
        self._tolerances: dict[tuple[str, str], ToleranceEntry] = {
            (entry.of, entry.figure): entry for entry in plan.tolerances
        }
        self._doubtful = {
            name
            for name, points in assigned.items()
            if not all(point.quality.ok for point in points)
        }
        self._doubtful |= {f.name for f in plan.features if f.plane in self._doubtful}
        for relation in plan.relations:  # later ones rest on earlier ones
            if self._doubtful.intersection(relation.of):
                self._doubtful.add(relation.name)

    def results(self, of: str, figures: Sequence[Figure]) -> tuple[FigureResult, ...]:
        """Return figures of a feature in their units, with decisions."""
        return tuple(self._result(of, figure) for figure in figures)

    def _result(self, of: str, figure: Figure) -> FigureResult:
        is_coordinate = figure.name in ("x", "y", "z")
        # Where a part that expands keeps its place, the arm does not know.
        if self._expansion is not None and (self._is_of_part or not is_coordinate):
            figure = self._expansion.at_reference(figure)
        factor = np.rad2deg(1.0) if figure.is_angle else 1.0
        result = FigureResult(
            figure.name,
            "deg" if figure.is_angle else "mm",
            float(factor * figure.value),
            float(factor * figure.expanded) if self._is_known else None,
        )
        entry = self._tolerances.get((of, figure.name))
        if entry is None:
            return result
        decision: Conformity = "not judged"
        is_whole = figure.is_angle or (
            self._judges_lengths and not (is_coordinate and self._is_of_part)
        )
        if self._is_known and is_whole and of not in self._doubtful:
            decision = entry.tolerance.conformity(figure)
        limits = entry.tolerance
        return replace(
            result,
            nominal=float(factor * limits.nominal),
            lower=float(factor * limits.lower),
            upper=float(factor * limits.upper),
            conformity=decision,
        )


def _feature(
    entry: FeatureEntry,
    points: list[Point],
    centres_mm: Mapping[str, tuple[float, ...]],
    features: Features,
    judge: _Judge,
) -> FeatureResult:
    element = features.elements.get(entry.name)
    distances_mm: Sequence[float | None] = [None] * len(points)
    if element is not None and element.fit is not None:
        each = element.fit.distances_mm.reshape(len(points), -1)
        of_points_mm = (
            each[:, 0] if each.shape[1] == 1 else np.linalg.norm(each, axis=1)
        )
        distances_mm = of_points_mm.tolist()
    touches = tuple(
        TouchResult(
            p.id,
            p.seq,
            centres_mm[p.id],
            mm,
            () if p.quality.ok else p.quality.flags,
            p.part.scan if isinstance(p, Sample) else "",
        )
        for p, mm in zip(points, distances_mm, strict=True)
    )
    scans = tuple(scan_parts(points))
    result = FeatureResult(
        entry.name, entry.kind, entry.side, touches=touches, scans=scans
    )
    if element is None:
        problem = features.problems.get(entry.name, "not touched yet")
        return replace(result, problem=problem)
    figures = figures_of(element, features.errors)
    return _located(
        replace(result, figures=judge.results(entry.name, figures)), element
    )


def _relation(entry: RelationEntry, features: Features, judge: _Judge) -> FeatureResult:
    result = FeatureResult(entry.name, entry.kind, of=entry.of)
    missing = [name for name in entry.of if name not in features.elements]
    if missing:
        return replace(result, problem=f"{', '.join(missing)}: not measured")
    elements = [features.elements[name] for name in entry.of]
    try:
        match entry.kind:
            case "distance" | "angle" as kind:
                first, second = elements
                figures = [_BETWEEN[kind](first, second, features.errors)]
                return replace(result, figures=judge.results(entry.name, figures))
            case kind:
                element = related(kind, *elements)
    except ValueError as error:
        return replace(result, problem=str(error))
    features.elements[entry.name] = element
    figures = figures_of(element, features.errors)
    return _located(
        replace(result, figures=judge.results(entry.name, figures)), element
    )


def _located(result: FeatureResult, element: Element) -> FeatureResult:
    """Add where an element is, for pictures and other programs."""
    direction = element.direction.tolist() if element.direction.any() else None
    return replace(
        result,
        place_mm=tuple(element.place_mm.tolist()),
        direction=None if direction is None else tuple(direction),
    )
