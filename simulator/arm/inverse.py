"""Inverse kinematics: postures that put the ball in given places.

Damped least squares on the true geometry: with e the miss and J the derivative of the
ball's centre by the turns,

step = J' (J J' + damping^2)^-1 e + (1 - J+ J) g

where g turns the shank towards a given direction without moving the ball. See Nakamura
and Hanafusa (1986), J. Dyn. Sys. Meas. Control 108.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.simulator.arm.physics import (
    Mechanism,
    centre_rates,
    probe_pose,
    probe_rates,
)

N_SEARCH_STEPS = 40
N_ROUNDS = 12  # each draws new starts for what is not reached yet
DAMPING_MM = 20.0
SHANK_GAIN = 0.4
LONGEST_STEP_RAD = 0.4
REACHED_MM = 1e-9
TOLERANCE_MM = 3e-10  # of a posture that is exact
CHUNK = 2048  # poses whose matrices fit into the cache
LIMIT_MARGIN_RAD = 0.15  # kept free for approaching and articulating


@dataclass(frozen=True, slots=True)
class Reach:
    """Inverse kinematics of an arm within its joint limits.

    Attributes:
        limits_rad: (n_joints, 2) least and largest turn from the base posture.
    """

    mechanism: Mechanism
    limits_rad: Floats
    rng: np.random.Generator

    def postures(
        self, targets_mm: Floats, shanks: Floats, tilt_rad: float
    ) -> tuple[Floats, Booleans]:
        """Find a posture for every target (n, 3), each from a random start.

        The shank (n, 3) may be off by ``tilt_rad``.

        Returns:
            Turns (n, n_joints) and whether each target was reached.
        """
        n_targets = len(targets_mm)
        turns_rad = np.zeros((n_targets, self.mechanism.n_joints))
        reached = np.zeros(n_targets, dtype=bool)
        low, high = self.limits_rad[:, 0], self.limits_rad[:, 1]
        for _ in range(N_ROUNDS):
            missing = np.flatnonzero(~reached)
            if len(missing) == 0:
                break
            starts = self.rng.uniform(low, high, (len(missing), len(low)))
            leans = np.cos(tilt_rad * self.rng.uniform(0.1, 0.95, len(missing)))
            turns = self._search(starts, targets_mm[missing], shanks[missing], leans)
            centres, directions = probe_pose(self.mechanism, turns)
            misses = np.linalg.norm(centres - targets_mm[missing], axis=1)
            upright = np.sum(directions * shanks[missing], axis=1) >= np.cos(tilt_rad)
            inside = np.all(
                (turns >= low + LIMIT_MARGIN_RAD) & (turns <= high - LIMIT_MARGIN_RAD),
                axis=1,
            )
            good = (misses < REACHED_MM) & upright & inside
            turns_rad[missing[good]] = turns[good]
            reached[missing[good]] = True
        return turns_rad, reached

    def along(self, starts_rad: Floats, targets_mm: Floats) -> Floats:
        """Follow targets with the smallest motion of the joints.

        From postures (n, n_joints) near the first of (n_knots, n, 3) close targets.

        Returns:
            (n_knots, n, n_joints)
        """
        postures = np.empty((len(targets_mm), *starts_rad.shape))
        turns = starts_rad
        for knot, targets in enumerate(targets_mm):
            turns = self.exact(turns, targets)
            postures[knot] = turns
        return postures

    def path(self, start_rad: Floats, targets_mm: Floats) -> Floats:
        """`along` (n_knots, 3) targets from one posture: (n_knots, n_joints)."""
        return self.along(start_rad[None], targets_mm[:, None])[:, 0]

    def nearest(self, starts_rad: Floats, wishes_rad: Floats, at_mm: Floats) -> Floats:
        """Keep the ball in place and approach given postures as far as that allows.

        Args:
            starts_rad: (n, n_joints) postures with the ball in place.
            wishes_rad: (n_knots, n, n_joints), close to each other.
            at_mm: (n, 3)

        Returns:
            (n_knots, n, n_joints)
        """
        postures = np.empty_like(wishes_rad)
        turns = starts_rad
        for knot, target in enumerate(wishes_rad):
            _, rates = centre_rates(self.mechanism, turns)
            lacking = target - turns
            moved = np.einsum("mij,mj->mi", rates, lacking)
            turns = turns + lacking - damped_steps(rates, moved)
            turns = self.exact(turns, at_mm)
            postures[knot] = turns
        return postures

    def exact(self, turns_rad: Floats, targets_mm: Floats) -> Floats:
        """Move the ball (n, 3) exactly to near targets."""
        centres_mm, _ = probe_pose(self.mechanism, turns_rad)
        return shifted_postures(self.mechanism, turns_rad, targets_mm - centres_mm)

    def _search(
        self, turns: Floats, targets_mm: Floats, shanks: Floats, leans: Floats
    ) -> Floats:
        """Search from starts; turn the shank until its lean is small enough.

        ``leans`` are the cosines of the permitted angles.
        """
        low, high = self.limits_rad[:, 0], self.limits_rad[:, 1]
        for _ in range(N_SEARCH_STEPS):
            centres, directions, rates, shank_rates = probe_rates(self.mechanism, turns)
            leaning = np.sum(directions * shanks, axis=1) < leans
            steps = damped_steps(rates, targets_mm - centres, DAMPING_MM)
            wish = SHANK_GAIN * np.einsum("mij,mi->mj", shank_rates, shanks)
            wish *= leaning[:, None]
            moved = np.einsum("mij,mj->mi", rates, wish)
            steps += wish - damped_steps(rates, moved, 1e-3 * DAMPING_MM)
            lengths = np.linalg.norm(steps, axis=1, keepdims=True)
            steps *= np.minimum(1.0, LONGEST_STEP_RAD / np.maximum(lengths, 1e-12))
            turns = np.clip(
                turns + steps, low + LIMIT_MARGIN_RAD, high - LIMIT_MARGIN_RAD
            )
        return self.exact(turns, targets_mm)


def shifted_postures(
    mechanism: Mechanism, turns_rad: Floats, shifts_mm: Floats
) -> Floats:
    """Return turns (n, n_joints) that displace the ball by (n, 3) with least motion."""
    moved = np.array(turns_rad)
    for first in range(0, len(moved), CHUNK):
        rows = slice(first, first + CHUNK)
        centres_mm, _ = probe_pose(mechanism, moved[rows])
        targets_mm = centres_mm + shifts_mm[rows]
        for _ in range(4):
            centres_mm, rates = centre_rates(mechanism, moved[rows])
            misses_mm = targets_mm - centres_mm
            if np.max(np.abs(misses_mm)) < TOLERANCE_MM:
                break
            moved[rows] += damped_steps(rates, misses_mm)
    return moved


def damped_steps(
    rates: Floats, misses_mm: Floats, damping_mm: Floats | float = 0.0
) -> Floats:
    """Return least turns (n, n_joints) against misses (n, 3), damped by (n,) mm.

    J' (J J' + damping^2)^-1 miss, with the 3x3 system solved by Cramer's rule.
    """
    normal = rates @ rates.transpose(0, 2, 1)
    normal[:, (0, 1, 2), (0, 1, 2)] += np.reshape(damping_mm, (-1, 1)) ** 2
    first, second, third = normal[:, 0], normal[:, 1], normal[:, 2]
    crossed = np.stack(
        [_cross(second, third), _cross(third, first), _cross(first, second)], axis=1
    )
    volumes = np.einsum("mi,mi->m", first, crossed[:, 0])
    solved = np.einsum("mij,mi->mj", crossed, misses_mm)
    solved /= np.maximum(volumes, np.finfo(np.float64).tiny)[:, None]
    steps: Floats = np.einsum("mij,mi->mj", rates, solved)
    return steps


def _cross(a: Floats, b: Floats) -> Floats:
    out = np.empty_like(a)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, i] = a[:, j] * b[:, k] - a[:, k] * b[:, j]
    return out
