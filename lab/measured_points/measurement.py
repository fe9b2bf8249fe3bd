"""What was measured for acceptance: places of the ball's centre, by artefact."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.artefacts import Artefact


@dataclass(frozen=True, slots=True, eq=False)
class ArtefactTouches:
    """The touches of one artefact, in the order in which they were made.

    Attributes:
        places_mm: Centres of the ball, (n, 3).
        features: (n,).
        temperature_c: NaN where unknown, (n,).
        tip_mm: Radius of the ball, (n,).
    """

    places_mm: Floats
    features: tuple[str, ...]
    temperature_c: Floats
    tip_mm: Floats

    def __len__(self) -> int:
        return len(self.features)

    def part(self, rows: list[int]) -> "ArtefactTouches":
        """Take some of the touches."""
        return ArtefactTouches(
            self.places_mm[rows],
            tuple(self.features[row] for row in rows),
            self.temperature_c[rows],
            self.tip_mm[rows],
        )

    def of(self, feature: str) -> "ArtefactTouches":
        """Take the touches of a feature."""
        rows = [row for row, name in enumerate(self.features) if name == feature]
        return self.part(rows)

    def runs(self) -> list["ArtefactTouches"]:
        """Cut where the feature changes."""
        starts = [
            row
            for row, name in enumerate(self.features)
            if row == 0 or name != self.features[row - 1]
        ]
        ends = [*starts[1:], len(self)]
        return [
            self.part(list(range(first, end)))
            for first, end in zip(starts, ends, strict=True)
        ]


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """Everything that was touched, with the artefacts' certificates.

    Attributes:
        artefacts: By id, as the campaign file has them.
        touched: By id; nothing for those that nobody touched.
        arm_name: Of the arm.
        shoulder_mm: Where the arm's reach is counted from, (3,).
        reach_mm: How far the ball gets from there, at most.
        notes: What is not as it should be, but no reason to refuse.
    """

    artefacts: Mapping[str, Artefact]
    touched: Mapping[str, ArtefactTouches]
    arm_name: str
    shoulder_mm: Floats
    reach_mm: float
    notes: tuple[str, ...] = ()

    def of(self, name: str) -> ArtefactTouches:
        """The touches of an artefact; none where there are none."""
        empty = ArtefactTouches(np.empty((0, 3)), (), np.empty(0), np.empty(0))
        return self.touched.get(name, empty)

    def distance_share(self, places_mm: Floats) -> Floats:
        """Say how far places are from the shoulder, as parts of the reach, (n,)."""
        away_mm = np.linalg.norm(places_mm - self.shoulder_mm, axis=1)
        shares: Floats = away_mm / self.reach_mm
        return shares


def reach_of(arm: Arm) -> tuple[Floats, float]:
    """Say where the second joint is in the base posture, and how far the ball gets.

    The first joint turns the whole arm; from the second on links add up at most.
    """
    links_mm = np.array([joint.link_mm for joint in arm.joints], dtype=np.float64)
    links_mm[-1] += np.array(arm.probe.vector_mm)
    first = min(1, len(links_mm) - 1)
    shoulder_mm = np.array(arm.origin_mm) + links_mm[:first].sum(axis=0)
    return shoulder_mm, float(np.sum(np.linalg.norm(links_mm[first:], axis=1)))


def measurement_of_touches(
    arm: Arm,
    artefacts: Mapping[str, Artefact],
    names: tuple[Sequence[str], Sequence[str]],
    numbers: Floats,
    notes: Iterable[str],
) -> Measurement:
    """Sort touches by artefact.

    Args:
        arm: Of the measurement.
        artefacts: By id.
        names: Of the artefact and the feature of every touch, (n,) each.
        numbers: Place of the ball's centre, temperature, radius of the tip, (n, 5).
        notes: What is not as it should be.
    """
    by_name: dict[str, list[int]] = {}
    for row, name in enumerate(names[0]):
        by_name.setdefault(name, []).append(row)
    shoulder_mm, reach_mm = reach_of(arm)
    touched = {
        name: ArtefactTouches(
            numbers[rows, :3],
            tuple(names[1][row] for row in rows),
            numbers[rows, 3],
            numbers[rows, 4],
        )
        for name, rows in by_name.items()
    }
    return Measurement(
        artefacts=artefacts,
        touched=touched,
        arm_name=arm.name,
        shoulder_mm=shoulder_mm,
        reach_mm=reach_mm,
        notes=tuple(notes),
    )
