"""The part that is being inspected: features chosen, touches assigned, results."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field

from traverse.arrays import Floats
from traverse.client.display.arm_state import ArmSight, Change
from traverse.client.display.stations import Stations
from traverse.client.inspection.best_fit import BestFit
from traverse.client.inspection.plan import (
    FeatureEntry,
    PartTemperature,
    Plan,
    RelationEntry,
    RelationKind,
    ToleranceEntry,
)
from traverse.client.inspection.results import alignment_of, inspected
from traverse.client.inspection.scan_samples import Sample, ThinnedScan
from traverse.client.inspection.systems import (
    system_by_best_fit,
    system_by_leapfrog,
    system_of_datums,
)
from traverse.client.inspection.values import FeatureResult, Inspection
from traverse.kinematics.features.measured import Side
from traverse.kinematics.fits.elements import Kind
from traverse.kinematics.helmert.transformation import Helmert
from traverse.protocol.messages import Point, Scan
from traverse.protocol.messages.fields import Vector
from traverse.protocol.messages.later_doubt import LaterDoubt, flagged_by

GOOD_COUNTS: dict[Kind, int] = {
    "point": 1,
    "line": 5,
    "plane": 9,
    "circle": 7,
    "sphere": 9,
    "cylinder": 12,
    "cone": 12,
}
"""Touches that also show form, as BS 7172 recommends."""
WHERE: dict[Kind, str] = {
    "point": "Touch the point.",
    "line": "Touch along the edge, from end to end.",
    "plane": "Touch the plane, as far apart as it allows.",
    "circle": "Touch around the wall, evenly.",
    "sphere": "Touch the pole, and around the sphere in two heights.",
    "cylinder": "Touch around the cylinder, in three heights.",
    "cone": "Touch around the cone, in three heights.",
}
LEAST_COMMON = 3
AGAIN = " again"
MOST_FEATURES, MOST_TOUCHES = 200, 4000

Share = Callable[[Sequence[Point]], Awaitable[Mapping[str, Floats] | str]]


@dataclass(slots=True)
class Draft:
    """A feature as chosen so far; `points` are ids."""

    kind: Kind
    side: Side = "auto"
    plane: str | None = None
    points: list[str] = field(default_factory=list)


class InspectionDesk:
    """The present part, shared by all pages; it survives their reloads.

    Args:
        sight: of the arm; its points are taken.

    Attributes:
        ball_radius_std_mm, part_temperature: as of `Plan`.
        features, relations, tolerances: in the order in which they were made.
        active: name of the feature that new points belong to; None: to none.
        alignment: made of features of this part; None: as the points have it.
        stations: where the arm stood at this part.
        scanned: samples of the running scan for the active feature; None without. They
            belong to it when the scan ends, or when the feature is accepted.
        inspection: the latest results; None before the first.
    """

    def __init__(self, sight: ArmSight) -> None:
        self._sight = sight
        self.part = self.serial = self.operator = ""
        self.ball_radius_std_mm: float | None = None
        self.part_temperature: PartTemperature | None = None
        self.features: dict[str, Draft] = {}
        self.relations: dict[str, RelationEntry] = {}
        self.tolerances: dict[tuple[str, str], ToleranceEntry] = {}
        self.active: str | None = None
        self.alignment: Helmert | None = None
        self.stations = Stations()
        self.scanned: ThinnedScan | None = None
        self.inspection: Inspection | None = None
        self.version = 0
        self._measured = 0
        self._is_measuring = False
        self._begun_ns = 0
        self._points: dict[str, Point] = {}
        self._shared: dict[str, Floats] = {}
        self._refusal = ""
        sight.listeners.append(self._changed)
        sight.scan_listeners.append(self._take_scan)
        sight.doubt_listeners.append(self._take_doubt)

    def begin(self, kind: Kind) -> str:
        """Begin a feature; return its name.

        Raises:
            ValueError: there are too many, or it is not known where the arm stands.
        """
        self.stations.refuse_while_moved()
        if len(self.features) >= MOST_FEATURES:
            raise ValueError(f"a part has at most {MOST_FEATURES} features; begin anew")
        name = self._free_name(kind)
        draft = Draft(kind)
        if kind in ("circle", "line"):
            planes = [
                n for n, feature in self.features.items() if feature.kind == "plane"
            ]
            draft.plane = planes[-1] if planes else None
        self.features[name] = draft
        return self.touch(name)

    def touch(self, name: str) -> str:
        """Have new points belong to a feature; return its name.

        Raises:
            ValueError: it was touched before the arm was moved.
        """
        if name not in self.stations.again:
            self.stations.refuse_while_moved()
        self._end_scan()
        self.active = name
        self._begun_ns = self._sight.live.time_ns if self._sight.live else 0
        self.version += 1
        return name

    def accept(self) -> None:
        """End the active feature; one without touches is dropped."""
        self._end_scan()
        name = self.active
        if (
            name is not None
            and name not in self.stations.again
            and not self.features[name].points
        ):
            self.remove(name)
        self.active = None
        self.version += 1

    def remove(self, name: str) -> None:
        """Remove a feature or relation, and all relations made of it."""
        self.features.pop(name, None)
        self.relations.pop(name, None)
        self.stations.again.pop(name, None)
        for draft in self.features.values():
            draft.plane = None if draft.plane == name else draft.plane
        for dependent in [n for n, entry in self.relations.items() if name in entry.of]:
            self.remove(dependent)
        for key in [key for key in self.tolerances if key[0] == name]:
            del self.tolerances[key]
        self.active = None if self.active == name else self.active
        self.version += 1

    def assign(self, point_id: str, name: str | None) -> None:
        """Move a touch to another feature, or leave it out (None)."""
        for draft in self.features.values():
            if point_id in draft.points:
                draft.points.remove(point_id)
        if name is not None:
            self.features[name].points.append(point_id)
        self.version += 1

    def relate(self, kind: RelationKind, of: Sequence[str]) -> str:
        """Add a relation; return its name.

        Raises:
            ValueError: it is not known where the arm stands.
        """
        self.stations.refuse_while_moved()
        name = self._free_name(kind)
        self.relations[name] = RelationEntry(name=name, kind=kind, of=tuple(of))
        self.version += 1
        return name

    def align(self, names: Sequence[str]) -> Helmert:
        """Make the part's system of a plane, a line and a point; return it.

        Raises:
            ValueError: they make none.
        """
        self.stations.refuse_while_moved()
        points, _ = self.stations.placed(self._points.values(), "not needed")
        system = system_of_datums(self.plan, points, names)
        self.align_to(system)
        return system

    def fit(self, nominals_mm: Mapping[str, Vector]) -> BestFit:
        """Fit features onto their nominal places; nothing is changed by it.

        Raises:
            ValueError: they do not determine the part's system.
        """
        self.stations.refuse_while_moved()
        shared_mm = self._refusal or self._shared
        placed, shared = self.stations.placed(self._points.values(), shared_mm)
        return system_by_best_fit(self.plan, placed, shared, nominals_mm)

    def align_to(self, system: Helmert) -> None:
        """State all results in a system of the part."""
        self.alignment = system
        self.version += 1

    def begin_leapfrog(self) -> None:
        """Have features that have a place touched once more: the arm was moved.

        Raises:
            ValueError: too few have one, or it was moved before.
        """
        self.stations.refuse_while_moved()
        common = [
            name for name in self.features if AGAIN not in name and self.has_place(name)
        ]
        if len(common) < LEAST_COMMON:
            raise ValueError("a leapfrog needs three features that have a place")
        if self.alignment is None:
            self.alignment = alignment_of([*self._points.values()])
        self.accept()
        again: dict[str, str] = {}
        again_by_before: dict[str | None, str] = {}
        planes = {self.features[name].plane for name in common} - {None}
        for name in [n for n in self.features if n in planes] + common:
            draft = self.features[name]
            name_again = self._free_name(f"{name}{AGAIN}")
            plane = again_by_before.get(draft.plane)
            self.features[name_again] = Draft(draft.kind, draft.side, plane)
            again[name_again] = name
            again_by_before[name] = name_again
        self.stations.move(again)
        self.version += 1

    def fit_leapfrog(self) -> BestFit:
        """Fit what was touched again onto the same features of before.

        Raises:
            ValueError: that does not determine where the arm stands.
        """
        touched_again = {
            again: before
            for again, before in self.stations.again.items()
            if self.features[again].points and self.has_place(before)
        }
        shared_mm = self._refusal or self._shared
        placed, shared = self.stations.placed(self._points.values(), shared_mm)
        return system_by_leapfrog(self.plan, placed, shared, touched_again)

    def end_leapfrog(self, fit: BestFit | None) -> Helmert | None:
        """Bring all touches since into the first station's system.

        Args:
            fit: of `fit_leapfrog`; None: the arm was not moved, what was touched again
                goes.

        Returns:
            From the arm's system now to the part's, else to the first station's.
        """
        names = list(self.stations.again)
        touched_again = [i for name in names for i in self.features[name].points]
        before = [self.features.get(name) for name in self.stations.again.values()]
        touched_before = [i for draft in before if draft for i in draft.points]
        self.stations.join(fit, touched_again, touched_before)
        for name in names:
            if fit is None or not self.features[name].points:
                self.remove(name)
        self.accept()
        if fit is None or self.alignment is None:
            return None if fit is None else fit.system
        return self.alignment.after(fit.system)

    def set_tolerance(self, entry: ToleranceEntry | None, key: tuple[str, str]) -> None:
        """Set the tolerance of a figure, by its feature and name; None: none."""
        self.tolerances.pop(key, None)
        if entry is not None:
            self.tolerances[key] = entry
        self.version += 1

    def set_about(self, part: str, serial: str, operator: str) -> None:
        self.part, self.serial, self.operator = part, serial, operator
        self.version += 1

    def set_conditions(
        self,
        ball_radius_std_mm: float | None,
        part_temperature: PartTemperature | None,
    ) -> None:
        self.ball_radius_std_mm = ball_radius_std_mm
        self.part_temperature = part_temperature
        self.version += 1

    def clear(self) -> None:
        """Begin with another part, by the same operator."""
        self.features, self.relations, self.tolerances = {}, {}, {}
        self._points, self._shared, self.active, self.scanned = {}, {}, None, None
        self.alignment = None
        self.stations = Stations()
        self.part = self.serial = ""
        self.part_temperature = None
        self.version += 1

    def touches_of(self, name: str) -> int:
        """Return how many touches a feature has, beside samples of scans."""
        ids = self.features[name].points
        return sum(not isinstance(self._points[i], Sample) for i in ids)

    def result(self, name: str) -> FeatureResult | None:
        features = () if self.inspection is None else self.inspection.features
        return next((feature for feature in features if feature.name == name), None)

    def has_place(self, name: str) -> bool:
        """Whether a feature or relation is a point, or has a centre."""
        result = self.result(name)
        if result is None or result.place_mm is None:
            return False
        return result.kind in ("point", "circle", "sphere") or result.direction is None

    @property
    def plan(self) -> Plan:
        entries = [
            FeatureEntry(
                name=name,
                kind=draft.kind,
                side=draft.side,
                plane=draft.plane,
                points=tuple(draft.points),
            )
            for name, draft in self.features.items()
        ]
        entries.sort(key=lambda entry: entry.kind != "plane")  # stable: planes first
        return Plan(
            schema="traverse/features/1",
            part=self.part,
            serial=self.serial,
            operator=self.operator,
            ball_radius_std_mm=self.ball_radius_std_mm,
            part_temperature=self.part_temperature,
            features=tuple(entries),
            relations=tuple(self.relations.values()),
            tolerances=tuple(self.tolerances.values()),
        )

    async def measure(self, share: Share) -> bool:
        """Compute all results anew if something has changed.

        Args:
            share: asks the arm for the points' common errors; else says why not.

        Returns:
            Whether there are new results.
        """
        if self._measured == self.version or self._is_measuring:
            return False
        self._is_measuring = True
        try:
            version, plan = self.version, self.plan
            used = {i for draft in self.features.values() for i in draft.points}
            missing = [
                point
                for i, point in self._points.items()
                if i in used and i not in self._shared
            ]
            if missing:
                answer = await share(missing)
                self._refusal = answer if isinstance(answer, str) else ""
                if not isinstance(answer, str):
                    self._shared.update(answer)
            points, shared = self.stations.placed(
                self._points.values(), self._refusal or dict(self._shared)
            )
            # In a thread: a part of many cylinders takes a while.
            inspection = await asyncio.to_thread(
                inspected, plan, points, shared, self.alignment
            )
            self.inspection = self.stations.without_places(inspection)
            self._measured = version
        finally:
            self._is_measuring = False
        return True

    def _free_name(self, kind: str) -> str:
        used_names = self.features.keys() | self.relations.keys()
        number = 1
        while f"{kind} {number}" in used_names:
            number += 1
        return f"{kind} {number}"

    def _changed(self, change: Change) -> None:
        point = change.point
        if point is None or change.kind == "doubt":
            return
        if point.retracts is not None:
            if self._points.pop(point.retracts, None) is not None:
                self.assign(point.retracts, None)
        elif self.active is not None and point.time_ns >= self._begun_ns:
            self._add(self.active, [point])

    def _take_doubt(self, doubt: LaterDoubt) -> None:
        self._points = {name: doubt.flagged(p) for name, p in self._points.items()}
        self.version += 1

    def _take_scan(self, block: Scan) -> None:
        if self.active is None or block.time_ns < self._begun_ns:
            return
        if self.scanned is None or self.scanned.part.scan != block.scan:
            self._end_scan()
            self.scanned = ThinnedScan(block.session, block.scan)
        self.scanned.add(block)
        if block.last:
            self._end_scan()

    def _end_scan(self) -> None:
        scanned, self.scanned = self.scanned, None
        if scanned is not None and self.active is not None:
            doubts = self._sight.doubts  # also those since a block came
            samples = [flagged_by(doubts, sample) for sample in scanned.samples()]
            self._add(self.active, samples)

    def _add(self, name: str, points: Sequence[Point]) -> None:
        if len(self._points) + len(points) > MOST_TOUCHES:
            self._sight.refuse(
                f"a part has at most {MOST_TOUCHES} touches; this point is in the "
                "session only",
                "begin a new part",
            )
            return
        for point in points:
            self._points[point.id] = point
            self.stations.take(point.id, name)
            self.assign(point.id, name)
