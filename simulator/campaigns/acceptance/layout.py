"""Places of standards in acceptance tests, and the points touched on them.

Written from the standards' descriptions, not from the code that evaluates tests.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.campaigns.artefacts import (
    Artefact,
    BallBar,
    Cone,
    Plane,
    Points,
    Sphere,
)
from traverse.simulator.campaigns.artefacts.artefact import Placement, Table


class CalibratedSphere(Sphere):
    """Calibrated sphere whose touches have names of groups."""

    kind: Literal["sphere"] = "sphere"
    known: bool = True
    groups: tuple[str, ...] = ("",)

    @property
    def features(self) -> tuple[str, ...]:
        return self.groups


class CalibratedFlat(Plane):
    """Perfect flat, whose certificate states a form error all the same."""

    kind: Literal["plane"] = "plane"
    form_mm: float = 0.0005

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        return {"form_mm": self.form_mm}


class SidedCone(Cone):
    """Seat that is touched with the elbow to either side."""

    kind: Literal["cone"] = "cone"

    @property
    def features(self) -> tuple[str, ...]:
        return ("left", "right")


class SeatBar(Points):
    """Bar with a seat at each end."""

    kind: Literal["points"] = "points"
    n_points: int = 2
    size_mm: float = 1.0
    length_mm: float
    length_std_mm: float = 0.0

    @property
    def features(self) -> tuple[str, ...]:
        return ("a", "b")

    @property
    def own_mm(self) -> Floats:
        ends = np.zeros((2, 3))
        ends[:, 2] = -0.5 * self.length_mm, 0.5 * self.length_mm
        return ends

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        """Return the certified length; each end has its part of the error."""
        ends_mm = self.own_mm
        ends_mm[1, 2] += self.length_std_mm * float(rng.standard_normal())
        table: Table = {"frame": "own"}
        if self.length_std_mm > 0.0:
            table["points_std_mm"] = self.length_std_mm / float(np.sqrt(2.0))
        if self.expansion_per_c:
            table["expansion_per_c"] = self.expansion_per_c
        names = dict(zip(self.features, ends_mm.tolist(), strict=True))
        return {**table, "points_mm": names}


RADIUS_MM = 12.7
FLAT_MM = 100.0
N_SCANNED, N_SCANNED_GROUP = 250, 50
PER_BALL = 5
N_LENGTHS, N_REPEATS = 5, 3
DIRECTIONS = np.array(
    [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 1.0, 1.0],
        [1.0, 1.0, -1.0],
        [1.0, -1.0, 1.0],
        [1.0, -1.0, -1.0],
    ]
)
UP = np.array([0.0, 0.0, 1.0])
# Distances from the shoulder as parts of the reach, well within what is required.
ZONES = {"near": (0.12, 0.19), "middle": (0.4, 0.6), "far": (0.82, 0.92)}
# Of the probe in the five groups of the test of location.
SHANKS = {
    "down": (0.0, 0.0, -1.0),
    "left": (0.0, 1.0, 0.0),
    "right": (0.0, -1.0, 0.0),
    "towards": (-1.0, 0.0, 0.0),
    "away": (1.0, 0.0, 0.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class PlacedStandard:
    """One standard in one place.

    Attributes:
        way: direction of its third axis, (3,).
        zone: least and largest distance of its middle from the shoulder over the
            reach.
        features: of every touch, in order.
        own_mm: ball centres in the standard's coordinates, (n, 3).
        towards: towards the material, NaN in seats, (n, 3).
        shanks: required direction of the probe, NaN for any, (n, 3).
    """

    artefact: Artefact
    way: Floats
    zone: tuple[float, float]
    features: tuple[str, ...]
    own_mm: Floats
    towards: Floats
    shanks: Floats


def layout_of(
    standard: str, reach_mm: float, ball_mm: float, *, std_mm: float = 0.0005
) -> Iterator[PlacedStandard]:
    """Place the standards of a test.

    ``standard`` is one of `traverse verify --plan`. ``reach_mm`` is from the second
    joint, ``ball_mm`` a radius; certificates state ``std_mm``.
    """
    if standard == "iso10360-12":
        yield from _iso(reach_mm, ball_mm, std_mm)
    elif standard == "asme-b89.4.22":
        yield from _b89(reach_mm, ball_mm, std_mm)
    elif standard == "iso10360-8":
        yield from _scans(ball_mm, std_mm)
    elif standard == "vdi2617-9":
        for number, way in enumerate(DIRECTIONS, 1):
            bar = _ball_bar(f"check-{number}", 0.6 * reach_mm, std_mm)
            yield _bar(bar, way, 3, ball_mm)
    else:
        raise ValueError(f"no standard {standard!r}")


def cap_pattern(rings: tuple[tuple[int, float], ...]) -> Floats:
    """Unit vectors (n, 3): so many at such an angle (degrees) from the third axis."""
    directions = []
    for index, (number, angle_deg) in enumerate(rings):
        around = 2.0 * np.pi * (np.arange(number) + 0.5 * (index % 2)) / number
        off = np.deg2rad(angle_deg)
        directions.append(
            np.column_stack(
                [
                    np.sin(off) * np.cos(around),
                    np.sin(off) * np.sin(around),
                    np.full(number, np.cos(off)),
                ]
            )
        )
    return np.concatenate(directions)


PATTERN_25 = cap_pattern(((1, 0.0), (4, 22.5), (8, 45.0), (4, 67.5), (8, 90.0)))
PATTERN_9 = cap_pattern(((1, 0.0), (4, 45.0), (4, 90.0)))
PATTERN_5 = cap_pattern(((1, 0.0), (4, 80.0)))


def _iso(reach_mm: float, ball_mm: float, std_mm: float) -> Iterator[PlacedStandard]:
    for name, zone in (("probing-1", (0.3, 0.5)), ("probing-2", (0.6, 0.8))):
        yield _sphere(name, {"": PATTERN_25}, zone, ball_mm, std_mm)
    groups = dict.fromkeys(SHANKS, PATTERN_5)
    yield _sphere("articulated", groups, (0.4, 0.6), ball_mm, std_mm)
    for position, way in enumerate(DIRECTIONS, 1):
        for number in range(1, N_LENGTHS + 1):
            length_mm = 0.7 * 2.0 * reach_mm * number / N_LENGTHS
            bar = SeatBar(
                id=f"uni-{position}-{number}",
                n_poses=2 * N_REPEATS,
                length_mm=length_mm,
                length_std_mm=std_mm,
            )
            features = ("a", "b") * N_REPEATS
            rows = [0, 1] * N_REPEATS
            yield PlacedStandard(
                bar,
                way / np.linalg.norm(way),
                (0.0, 0.7),
                features,
                bar.own_mm[rows],
                np.full((len(rows), 3), np.nan),
                np.full((len(rows), 3), np.nan),
            )


def _b89(reach_mm: float, ball_mm: float, std_mm: float) -> Iterator[PlacedStandard]:
    repeats = dict.fromkeys("123", PATTERN_9)
    yield _sphere("diameter", repeats, (0.4, 0.6), ball_mm, std_mm)
    for name, zone in ZONES.items():
        sides = ("left",) * 5 + ("right",) * 5
        cone = SidedCone(id=f"spat-{name}", n_poses=10)
        none = np.full((10, 3), np.nan)
        yield PlacedStandard(cone, UP, zone, sides, np.zeros((10, 3)), none, none)
    for number in range(1, 21):
        share = 0.6 if number <= 10 else 1.3
        way = DIRECTIONS[(number - 1) % len(DIRECTIONS)]
        bar = _ball_bar(f"volumetric-{number:02d}", share * reach_mm, std_mm)
        yield _bar(bar, way, 1, ball_mm)


def spiral(n: int, opening_deg: float) -> Floats:
    """Unit vectors (n, 3) on a spiral about the third axis, in the order of a scan."""
    heights = np.linspace(1.0, np.cos(np.deg2rad(opening_deg)), n)
    turns = np.arange(n) * np.pi * (3.0 - np.sqrt(5.0))
    aside = np.sqrt(1.0 - heights**2)
    return np.column_stack([aside * np.cos(turns), aside * np.sin(turns), heights])


def _scans(ball_mm: float, std_mm: float) -> Iterator[PlacedStandard]:
    half = {"": spiral(N_SCANNED, 90.0)}
    yield _sphere("scan-sphere", half, (0.4, 0.6), ball_mm, std_mm)
    groups = dict.fromkeys(SHANKS, spiral(N_SCANNED_GROUP, 80.0))
    yield _sphere("scan-articulated", groups, (0.4, 0.6), ball_mm, std_mm)
    flat = CalibratedFlat(id="scan-flat", n_poses=N_SCANNED, size_mm=FLAT_MM)
    side = np.linspace(-0.5, 0.5, 10) * FLAT_MM
    across, along = np.meshgrid(side, np.linspace(-0.5, 0.5, N_SCANNED // 10) * FLAT_MM)
    centres = np.column_stack(
        [across.ravel(), along.ravel(), np.full(N_SCANNED, ball_mm)]
    )
    yield PlacedStandard(
        flat,
        np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0),
        (0.4, 0.6),
        ("",) * N_SCANNED,
        centres,
        np.tile([0.0, 0.0, -1.0], (N_SCANNED, 1)),
        np.full((N_SCANNED, 3), np.nan),
    )


def _sphere(
    name: str,
    groups: dict[str, Floats],
    zone: tuple[float, float],
    ball_mm: float,
    std_mm: float,
) -> PlacedStandard:
    outwards = np.concatenate(list(groups.values()))
    features = tuple(
        group for group, pattern in groups.items() for _ in range(len(pattern))
    )
    shanks = np.full(outwards.shape, np.nan)
    if name.endswith("articulated"):
        shanks = np.array([SHANKS[feature] for feature in features])
        # Each group is touched around the direction of the probe.
        outwards = np.concatenate(
            [_about(-np.array(SHANKS[group]), groups[group]) for group in groups]
        )
    sphere = CalibratedSphere(
        id=name,
        n_poses=len(outwards),
        radius_mm=RADIUS_MM,
        radius_std_mm=0.5 * std_mm,
        groups=tuple(groups),
    )
    away_mm = RADIUS_MM + ball_mm
    return PlacedStandard(
        sphere, UP, zone, features, away_mm * outwards, -outwards, shanks
    )


def _about(pole: Floats, pattern: Floats) -> Floats:
    """Turn a pattern about the third axis into one about another."""
    least = np.eye(3)[int(np.argmin(np.abs(pole)))]
    first = np.cross(pole, least)
    first /= np.linalg.norm(first)
    turned: Floats = pattern @ np.stack([first, np.cross(pole, first), pole])
    return turned


def _ball_bar(name: str, length_mm: float, std_mm: float) -> BallBar:
    return BallBar(
        id=name,
        n_poses=1,
        radius_mm=RADIUS_MM,
        distance_mm=length_mm,
        distance_std_mm=std_mm,
    )


def _bar(bar: BallBar, way: Floats, repeats: int, ball_mm: float) -> PlacedStandard:
    # Both balls alike, from the side: about an axis across the bar.
    outwards = _about(np.array([1.0, 0.0, 0.0]), PATTERN_5)
    centres, towards, features = [], [], []
    for _ in range(repeats):
        for feature, end in (("1", -0.5), ("2", 0.5)):
            centre_mm = np.array([0.0, 0.0, end * bar.distance_mm])
            centres.append(centre_mm + (RADIUS_MM + ball_mm) * outwards)
            towards.append(-outwards)
            features += [feature] * PER_BALL
    none = np.full((len(features), 3), np.nan)
    return PlacedStandard(
        bar,
        way / np.linalg.norm(way),
        (0.0, 0.75),
        tuple(features),
        np.concatenate(centres),
        np.concatenate(towards),
        none,
    )
