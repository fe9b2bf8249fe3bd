"""Guided checks at the page: what to do, progress, results so far."""

from dataclasses import dataclass, field

import numpy as np

from traverse.kinematics.fits import fit_sphere, spread_about_mean
from traverse.protocol.messages import Point


@dataclass(slots=True)
class GuidedCheck:
    """A check in progress.

    Attributes:
        kind: "articulation": one point, a cone, from many postures; "sphere".
        wanted: number of points to take.
        points: taken so far.
    """

    kind: str
    wanted: int
    points: list[Point] = field(default_factory=list)

    @property
    def is_done(self) -> bool:
        """All points are there."""
        return len(self.points) >= self.wanted

    @property
    def instruction(self) -> str:
        """What to do next."""
        left = self.wanted - len(self.points)
        if left <= 0:
            return "Done. Start again, or close."
        if self.kind == "articulation":
            side = "left" if len(self.points) % 2 else "right"
            return f"Ball in the cone, elbow to the {side}, take a point: {left} more."
        where = ("the top", "half way down", "the equator")[len(self.points) % 3]
        return f"Touch the sphere at {where}, another side each time: {left} more."

    def take(self, point: Point) -> None:
        """A point was received during the check."""
        if not self.is_done:
            self.points.append(point)

    def undo(self, point_id: str) -> None:
        """A point was taken back."""
        self.points = [p for p in self.points if p.id != point_id]

    @property
    def results(self) -> list[tuple[str, str, str]]:
        """Name, value with unit, and definition of each figure so far."""
        places_mm = np.array([p.xyz_mm for p in self.points], dtype=np.float64)
        if self.kind == "articulation":
            if len(places_mm) < 2:
                return []
            spread = spread_about_mean(places_mm)
            off_mm = np.linalg.norm(places_mm - places_mm.mean(axis=0), axis=1)
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
        try:
            sphere = fit_sphere(places_mm)
        except ValueError:
            return []
        radii_mm = np.linalg.norm(places_mm - sphere.centre_mm, axis=1)
        ball_mm = self.points[-1].probe_radius_mm
        return [
            (
                "Diameter",
                f"{2.0 * (sphere.radius_mm - ball_mm):.4f} mm",
                "least squares, less the probe's ball; touched from outside",
            ),
            ("Form", f"{np.ptp(radii_mm):.4f} mm", "largest less smallest radius"),
            ("Rms", f"{sphere.rms_mm:.4f} mm", "of the distances from the sphere"),
        ]
