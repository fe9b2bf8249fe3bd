"""Drags: the ball stays on an artefact while all joints move in slow waves.

From a drawn posture (a start and waves) the joints move as little as puts the ball on
the path: first at knots, one after the other, then in between.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.arm.inverse import shifted_postures
from traverse.simulator.arm.physics import probe_pose
from traverse.simulator.campaigns.artefacts import Cone, Sphere
from traverse.simulator.campaigns.artefacts.artefact import Placement
from traverse.simulator.campaigns.dense.spec import ScanTable
from traverse.simulator.campaigns.postures import Workspace
from traverse.simulator.campaigns.siting import UnreachableError

KNOT_S = 0.05
PULL = 0.05  # of what a posture is away from the wished one, per knot
N_REDRAWS = 40
FASTEST_RAD_S = 3.0
OVER_LIMIT_RAD = 0.3
OFF_PATH_MM = 1e-6
N_WAVES = 2
CAP_SHARE = 0.85  # of a sphere's opening, that is scanned


@dataclass(frozen=True, slots=True)
class Drag:
    """One drag over an artefact.

    Attributes:
        turns_rad: (n, n_joints)
        towards: (n, 3) from the ball towards the material; NaN in seats.
        contacts_mm: (n, 3) ball centres.
    """

    turns_rad: Floats
    towards: Floats
    contacts_mm: Floats


@dataclass(frozen=True, slots=True)
class Dragging:
    """Common parameters of drags.

    Attributes:
        ball_mm: radius of the ball.
        rng: draws paths and postures.
    """

    workspace: Workspace
    ball_mm: float
    scan: ScanTable
    rng: np.random.Generator

    def drag(self, artefact: Cone | Sphere, placement: Placement) -> Drag:
        """Draw one drag.

        Raises:
            UnreachableError: none of many drawn ones can be followed.
        """
        n_knots = max(int(np.ceil(self.scan.seconds / KNOT_S)) + 1, 4)
        knots_s = np.linspace(0.0, self.scan.seconds, n_knots)
        n_samples = max(round(self.scan.seconds * self.scan.rate_hz), 2)
        times_s = np.arange(n_samples) / self.scan.rate_hz
        for _ in range(N_REDRAWS):
            path = _Path.drawn(artefact, placement, self)
            centres_mm, _ = path.at(knots_s)
            followed = self._followed(centres_mm, knots_s)
            if followed is None:
                continue
            contacts_mm, towards = path.at(times_s)
            turns_rad = _between(followed, times_s / (knots_s[1] - knots_s[0]))
            places_mm, _ = probe_pose(self.workspace.mechanism, turns_rad)
            turns_rad = shifted_postures(
                self.workspace.mechanism, turns_rad, contacts_mm - places_mm
            )
            if self._is_smooth(turns_rad, contacts_mm):
                return Drag(turns_rad, towards, contacts_mm)
        raise UnreachableError(
            f"{artefact.kind} '{artefact.id}': none of {N_REDRAWS} drags can be "
            "followed by the joints; make `swing` smaller or `wave_s` longer"
        )

    def waves(self, times_s: Floats) -> Floats:
        """Draw smooth motions (n, n_joints) that begin at zero."""
        low, high = self.workspace.limits_rad.T
        n_joints = len(low)
        sizes_rad = 0.5 * self.scan.swing * (high - low) / np.sqrt(N_WAVES)
        waves = np.zeros((len(times_s), n_joints))
        for _ in range(N_WAVES):
            periods_s = self.scan.wave_s * self.rng.uniform(0.6, 1.8, n_joints)
            phases = self.rng.uniform(-np.pi, np.pi, n_joints)
            cycles = 2.0 * np.pi * times_s[:, None] / periods_s
            waves += sizes_rad * (np.sin(cycles + phases) - np.sin(phases))
        return waves

    def _followed(self, centres_mm: Floats, knots_s: Floats) -> Floats | None:
        """Follow a path from knot to knot; None if the joints cannot."""
        start, reached = self.workspace.reaching(centres_mm[:1], self.rng)
        if not reached[0]:
            return None
        wishes_rad = start + self.waves(knots_s)
        np.clip(wishes_rad, *self.workspace.limits_rad.T, out=wishes_rad)
        followed = np.empty_like(wishes_rad)
        turns = start[0]
        followed[0] = turns
        longest_rad = FASTEST_RAD_S * (knots_s[1] - knots_s[0])
        for knot in range(1, len(knots_s)):
            wished_step = wishes_rad[knot] - wishes_rad[knot - 1]
            pull = PULL * (wishes_rad[knot - 1] - turns)
            tried = (turns + wished_step + pull)[None, :]
            at_mm, _ = probe_pose(self.workspace.mechanism, tried)
            moved = shifted_postures(
                self.workspace.mechanism, tried, centres_mm[knot : knot + 1] - at_mm
            )[0]
            if not np.max(np.abs(moved - turns)) < longest_rad:
                return None
            turns = moved
            followed[knot] = turns
        low, high = self.workspace.limits_rad.T
        inside = (followed > low - OVER_LIMIT_RAD) & (followed < high + OVER_LIMIT_RAD)
        return followed if np.all(inside) else None

    def _is_smooth(self, turns_rad: Floats, contacts_mm: Floats) -> bool:
        places_mm, _ = probe_pose(self.workspace.mechanism, turns_rad)
        off_mm = float(np.max(np.abs(places_mm - contacts_mm)))
        speeds = np.abs(np.diff(turns_rad, axis=0)) * self.scan.rate_hz
        return off_mm < OFF_PATH_MM and bool(np.max(speeds) < FASTEST_RAD_S)


@dataclass(frozen=True, slots=True)
class _Path:
    """A smooth path of the ball's centre on an artefact.

    Attributes:
        radius_mm: from the artefact's centre to the ball's; 0 in a seat.
        inwards: -1 if the material is outwards, +1 inwards, NaN in a seat.
        opening_rad: largest angle from the pole.
        numbers: (4,) periods and phases of angle and azimuth.
    """

    placement: Placement
    radius_mm: float
    inwards: float
    opening_rad: float
    numbers: Floats

    @classmethod
    def drawn(
        cls, artefact: Cone | Sphere, placement: Placement, dragging: Dragging
    ) -> "_Path":
        rng, wave_s = dragging.rng, dragging.scan.wave_s
        periods_s = wave_s * rng.uniform(0.8, 2.0, 2) * (1.0, rng.choice((-1.0, 1.0)))
        numbers = np.append(periods_s, rng.uniform(-np.pi, np.pi, 2))
        if isinstance(artefact, Cone):
            return cls(placement, 0.0, np.nan, 0.0, numbers)
        side = 1.0 if artefact.side == "outside" else -1.0
        radius_mm = artefact.radius_mm + side * dragging.ball_mm
        opening_rad = CAP_SHARE * artefact.opening_rad
        return cls(placement, radius_mm, side, opening_rad, numbers)

    def at(self, times_s: Floats) -> tuple[Floats, Floats]:
        tilt_s, turn_s, tilt, turn = self.numbers
        angles = np.sin(2.0 * np.pi * times_s / tilt_s + tilt)
        angles = 0.5 * self.opening_rad * (1.1 + 0.9 * angles)
        around = 2.0 * np.pi * times_s / turn_s + turn
        outwards = np.stack(
            [
                np.sin(angles) * np.cos(around),
                np.sin(angles) * np.sin(around),
                np.cos(angles),
            ],
            axis=1,
        )
        centres_mm = self.placement.points_mm(self.radius_mm * outwards)
        return centres_mm, -self.inwards * self.placement.directions(outwards)


def moved_between(start_rad: Floats, end_rad: Floats, n_samples: int) -> Floats:
    """Move (n, n_joints) from rest to rest, both ends left out."""
    u = np.arange(1, n_samples + 1)[:, None] / (n_samples + 1.0)
    share = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    moved: Floats = start_rad + share * (end_rad - start_rad)
    return moved


def _between(knots: Floats, places: Floats) -> Floats:
    """Cubic pieces through knots (n_knots, n_joints), at places in knots (n,)."""
    rates = np.gradient(knots, axis=0)
    index = np.clip(places.astype(np.int64), 0, len(knots) - 2)
    u = (places - index)[:, None]
    first, second = knots[index], knots[index + 1]
    rise = second - first
    bend = rates[index] + rates[index + 1] - 2.0 * rise
    turns: Floats = first + u * (
        rates[index]
        + u * (3.0 * rise - 2.0 * rates[index] - rates[index + 1] + u * bend)
    )
    return turns
