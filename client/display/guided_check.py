"""Guided checks: instructions, progress, results, verdicts."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from traverse.client.display.arm_state import ArmSight, Change
from traverse.client.display.condition import Level
from traverse.kinematics.fits import (
    PLAUSIBLE_MM,
    fit_sphere,
    off_seat,
    off_sphere,
    spread_about_mean,
)
from traverse.plurals import counted
from traverse.protocol.messages import Label, Point


@dataclass(slots=True)
class GuidedCheck:
    """A check in progress.

    Attributes:
        kind: "articulation": one point, a cone, from many postures; "sphere".
        n_wanted: number of points to take.
        limit_mm: of the largest deviation from the mean, or of the sphere's form and
            its error of size; None: not set.
        diameter_mm: of the sphere by its certificate; None: unknown.
        begun_ns: earlier points do not count [UTC].
        suspect: a touch that cannot be of the same seat; not counted.
    """

    kind: str
    n_wanted: int
    limit_mm: float | None = None
    diameter_mm: float | None = None
    begun_ns: int = 0
    points: list[Point] = field(default_factory=list)
    suspect: Point | None = None

    @property
    def is_done(self) -> bool:
        return len(self.points) >= self.n_wanted

    @property
    def instruction(self) -> str:
        left = self.n_wanted - len(self.points)
        if self.suspect is not None:
            artefact = "seat" if self.kind == "articulation" else "sphere"
            off = f"{self._off_mm(self.suspect):.1f} mm off the others"
            return (
                f"Point {self.suspect.seq} is {off} and does not count. "
                f"Was it the right {artefact}?"
            )
        if left <= 0:
            return "Done. Start again, or close."
        if self.kind == "articulation":
            side = "left" if len(self.points) % 2 else "right"
            return f"Ball in the cone, elbow to the {side}, take a point: {left} more."
        where = ("the top", "half way down", "the equator")[len(self.points) % 3]
        return f"Touch the sphere at {where}, another side each time: {left} more."

    def take(self, point: Point) -> None:
        """Take a point during the check, whatever its label."""
        if self.is_done or point.time_ns < self.begun_ns:
            return
        if self._off_mm(point) > PLAUSIBLE_MM:
            self.suspect = point
        else:
            self.points.append(point)
            self.suspect = None  # the operator has corrected it

    def undo(self, point_id: str) -> None:
        self.points = [p for p in self.points if p.id != point_id]
        if self.suspect is not None and self.suspect.id == point_id:
            self.suspect = None

    def leave_out(self) -> None:
        self.suspect = None

    def count_in(self) -> None:
        """Count the suspect: the arm is really off by that much."""
        if self.suspect is not None:
            self.points.append(self.suspect)
        self.suspect = None

    def begin_with_it(self) -> None:
        """Begin again with the suspect: the others were at another place."""
        self.points = [] if self.suspect is None else [self.suspect]
        self.suspect = None

    @property
    def verdict(self) -> tuple[Level, str]:
        """Level and text; nothing passes without a limit."""
        if not self.is_done:
            return "busy", f"{len(self.points)} of {counted(self.n_wanted, 'point')}"
        doubtful = sum(not point.quality.ok for point in self.points)
        if doubtful:
            return "warning", f"No verdict: {doubtful} of the points in doubt."
        if self.limit_mm is None:
            return "warning", "No verdict: set a limit."
        worst = self._worst()
        if worst is None:
            return "warning", "No verdict: no sphere goes through these points."
        name, value_mm = worst
        passed = value_mm <= self.limit_mm
        return (
            "good" if passed else "bad",
            f"{'Passed' if passed else 'Failed'}: {name} {value_mm:.4f} mm, "
            f"limit {self.limit_mm:.4f} mm.",
        )

    @property
    def results(self) -> list[tuple[str, str, str]]:
        """Name, value with unit, and definition of each figure so far."""
        places_mm = _places(self.points)
        if self.kind == "articulation":
            if len(places_mm) < 2:
                return []
            spread = spread_about_mean(places_mm)
            off_mm = np.linalg.norm(places_mm - spread.mean_mm, axis=1)
            two_s_mm = 2.0 * np.sqrt((off_mm**2).sum() / (len(off_mm) - 1))
            half_mm = np.ptp(places_mm, axis=0) / 2.0
            return [
                ("Largest", f"{spread.max_deviation_mm:.4f} mm", "from the mean"),
                ("2 s", f"{two_s_mm:.4f} mm", "s² = Σδ²/(n-1)"),
                (
                    "Half range",
                    " / ".join(f"{value:.4f}" for value in half_mm) + " mm",
                    "(max - min)/2 in x / y / z",
                ),
            ]
        sphere = self._sphere()
        if sphere is None:
            return []
        diameter_mm, form_mm, rms_mm = sphere
        return [
            (
                "Diameter",
                f"{diameter_mm:.4f} mm",
                "least squares, less the probe's ball; touched from outside",
            ),
            ("Form", f"{form_mm:.4f} mm", "largest less smallest radius"),
            ("Rms", f"{rms_mm:.4f} mm", "of the distances from the sphere"),
        ]

    def _worst(self) -> tuple[str, float] | None:
        """Return name and value of the figure that is compared with the limit."""
        if self.kind == "articulation":
            spread = spread_about_mean(_places(self.points))
            return "largest deviation", spread.max_deviation_mm
        sphere = self._sphere()
        if sphere is None:
            return None
        diameter_mm, form_mm, _ = sphere
        values = [("form", form_mm)]
        if self.diameter_mm is not None:
            values.append(("error of size", abs(diameter_mm - self.diameter_mm)))
        return max(values, key=lambda item: item[1])

    def _sphere(self) -> tuple[float, float, float] | None:
        """Return diameter, form and rms of the sphere through the points."""
        places_mm = _places(self.points)
        try:
            sphere = fit_sphere(places_mm)
        except ValueError:
            return None
        radii_mm = np.linalg.norm(places_mm - sphere.centre_mm, axis=1)
        ball_mm = self.points[-1].probe_radius_mm
        diameter_mm = 2.0 * (sphere.radius_mm - ball_mm)
        return diameter_mm, float(np.ptp(radii_mm)), sphere.rms_mm

    def _off_mm(self, point: Point) -> float:
        """Return the distance of a touch from the mean of the others."""
        place_mm, others_mm = _places([point]), _places(self.points)
        if self.kind == "articulation":
            return float(off_seat(place_mm, others_mm)[0])
        widest_mm = self.diameter_mm
        if widest_mm is not None:
            widest_mm += 2.0 * point.probe_radius_mm
        return float(off_sphere(place_mm, others_mm, widest_mm)[0])


class CheckDesk:
    """The current guided check, shared by all pages; it survives their reloads.

    Args:
        sight: of the arm; its points are taken.

    Attributes:
        check: None while there is none.
        limits_mm: last given, by kind of check.
        diameter_mm: of the sphere, last given.
        label_before: label before the check set its own.
    """

    def __init__(self, sight: ArmSight) -> None:
        self._sight = sight
        self.check: GuidedCheck | None = None
        self.limits_mm: dict[str, float | None] = {}
        self.diameter_mm: float | None = None
        self.label_before = Label()
        sight.listeners.append(self._changed)

    def begin(self, kind: str, n_wanted: int) -> None:
        if self.check is None:
            self.label_before = self._sight.known_label or Label()
        live = self._sight.live
        self.check = GuidedCheck(kind, n_wanted, begun_ns=live.time_ns if live else 0)
        self.set_limits(self.limits_mm.get(kind), self.diameter_mm)

    def set_limits(self, limit_mm: float | None, diameter_mm: float | None) -> None:
        """Set limits and the sphere's diameter, stored for the next check."""
        if self.check is not None:
            self.limits_mm[self.check.kind] = self.check.limit_mm = limit_mm
            self.diameter_mm = self.check.diameter_mm = diameter_mm

    def answer(self, act: Callable[[GuidedCheck], None]) -> None:
        if self.check is not None:
            act(self.check)

    def _changed(self, change: Change) -> None:
        if self.check is None or change.point is None:
            return
        if change.kind == "doubt":
            self.check.undo(change.point.id)
        elif change.point.retracts is None:
            self.check.take(change.point)
        else:
            self.check.undo(change.point.retracts)


def _places(points: list[Point]) -> np.ndarray:
    return np.array([p.xyz_mm for p in points], dtype=np.float64).reshape(-1, 3)
