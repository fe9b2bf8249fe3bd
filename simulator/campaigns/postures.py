"""Joint limits, and postures within them that put the ball in given places.

Newton's method on the true geometry, damped while far away, each target from the
nearest of a few random starts: the free joints of a redundant arm stay as drawn, so
that postures vary.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.simulator.arm.inverse import CHUNK, TOLERANCE_MM, damped_steps
from traverse.simulator.arm.physics import Mechanism, centre_rates, probe_pose

# Largest turns of rolls and of hinges, in degrees.
TRAVELS_DEG: Mapping[str, tuple[float, float]] = {
    "full": (180.0, 180.0),
    "wide": (150.0, 75.0),
    "narrow": (60.0, 40.0),
}
ALONG = 0.7  # cosine from which on a joint turns about the element that it carries


def travel_limits(mechanism: Mechanism, travel: str) -> Floats:
    """Return least and largest turns (n_joints, 2) by the name of a travel.

    A roll turns about the element that it carries, a hinge folds it.
    """
    roll_rad, hinge_rad = np.deg2rad(TRAVELS_DEG[travel])
    largest = np.where(_rolls(mechanism), roll_rad, hinge_rad)
    return np.stack([-largest, largest], axis=1)


def _rolls(mechanism: Mechanism) -> Booleans:
    """Which joints (n_joints,) are rolls; one without length does not show it."""
    ends_mm = np.vstack([mechanism.origins_mm[1:], mechanism.probe_mm])
    rolls = np.zeros(mechanism.n_joints, dtype=bool)
    for k, axis in enumerate(mechanism.axes):
        elements_mm = ends_mm[k:] - mechanism.origins_mm[k]
        lengths_mm = np.linalg.norm(elements_mm, axis=1)
        long = np.flatnonzero(lengths_mm > 1.0)
        if len(long):
            along_mm = abs(float(axis @ elements_mm[long[0]]))
            rolls[k] = along_mm > ALONG * lengths_mm[long[0]]
    return rolls


N_STEPS = 14  # a new start then costs less than more of them
N_CHOICES = 24  # random starts from which each target takes the nearest;
MOST_CHOICES = 512  # twice as many in every round
LONGEST_STEP_RAD = 0.6
DAMPING_SHARE = 0.02  # of the miss: the step tends to Newton's as the miss vanishes
LEAST_DAMPING_MM = 1e-4


@dataclass(frozen=True, slots=True)
class Workspace:
    """Reach of an arm within its joint limits.

    Attributes:
        limits_rad: (n_joints, 2) least and largest turn from the base posture.
    """

    mechanism: Mechanism
    limits_rad: Floats

    def reaching(
        self, targets_mm: Floats, rng: np.random.Generator, n_rounds: int = 10
    ) -> tuple[Floats, Booleans]:
        """Find a posture for every target.

        Args:
            targets_mm: (n, 3) for the ball's centre.
            rng: draws the starts.
            n_rounds: starts for each target.

        Returns:
            Turns (n, n_joints) and whether each target was reached within tolerance and
            limits.
        """
        n_targets = len(targets_mm)
        turns_rad = np.zeros((n_targets, self.mechanism.n_joints))
        reached = np.zeros(n_targets, dtype=bool)
        for round_ in range(n_rounds):
            missing = np.flatnonzero(~reached)
            if len(missing) == 0:
                break
            for first in range(0, len(missing), CHUNK):
                rows = missing[first : first + CHUNK]
                n_choices = min(N_CHOICES << round_, MOST_CHOICES)
                starts = self._near_turns(targets_mm[rows], n_choices, rng)
                solved_rad, good = self._solved(targets_mm[rows], starts)
                turns_rad[rows[good]] = solved_rad[good]
                reached[rows[good]] = True
        return turns_rad, reached

    def drawn_turns(self, n_poses: int, rng: np.random.Generator) -> Floats:
        """Draw turns (n_poses, n_joints), uniform within the limits."""
        low, high = self.limits_rad.T
        return rng.uniform(low, high, (n_poses, len(self.limits_rad)))

    def _near_turns(
        self, targets_mm: Floats, n_choices: int, rng: np.random.Generator
    ) -> Floats:
        """Return, of a few random turns for each target (n, 3), the nearest."""
        n_targets = len(targets_mm)
        turns_rad = self.drawn_turns(max(n_targets, n_choices), rng)
        centres_mm, _ = probe_pose(self.mechanism, turns_rad)
        choices = rng.integers(0, len(turns_rad), (n_targets, n_choices))
        misses_mm = centres_mm[choices] - targets_mm[:, None]
        nearest = np.argmin(np.einsum("mki,mki->mk", misses_mm, misses_mm), axis=1)
        near: Floats = turns_rad[choices[np.arange(n_targets), nearest]]
        return near

    def _solved(
        self, targets_mm: Floats, starts_rad: Floats
    ) -> tuple[Floats, Booleans]:
        """Solve for targets (n, 3) from starts (n, n_joints)."""
        low, high = self.limits_rad.T
        turns_rad = starts_rad
        good = np.zeros(len(targets_mm), dtype=bool)
        rows = np.arange(len(targets_mm))
        stopped = np.zeros(turns_rad.shape, dtype=bool)  # at a limit: the others move
        for _ in range(N_STEPS):
            centres_mm, rates = centre_rates(self.mechanism, turns_rad[rows])
            misses_mm = targets_mm[rows] - centres_mm
            lengths_mm = np.sqrt(np.einsum("mi,mi->m", misses_mm, misses_mm))
            away = lengths_mm >= TOLERANCE_MM
            good[rows[~away]] = True
            if not np.any(away):
                break
            rows, misses_mm, rates = rows[away], misses_mm[away], rates[away]
            rates = np.where(stopped[rows][:, None], 0.0, rates)
            damping_mm = np.maximum(DAMPING_SHARE * lengths_mm[away], LEAST_DAMPING_MM)
            steps = damped_steps(rates, misses_mm, damping_mm)
            longest = np.max(np.abs(steps), axis=1, keepdims=True)
            steps *= np.minimum(1.0, LONGEST_STEP_RAD / np.maximum(longest, 1e-12))
            wanted_rad = turns_rad[rows] + steps
            turns_rad[rows] = np.clip(wanted_rad, low, high)
            stopped[rows] = turns_rad[rows] != wanted_rad
        return turns_rad, good


def workspace_of(
    mechanism: Mechanism,
    travel: str,
    limits_rad: Sequence[tuple[float, float]] | None = None,
) -> Workspace:
    """Use given limits, or a named travel's."""
    if limits_rad is None:
        return Workspace(mechanism, travel_limits(mechanism, travel))
    return Workspace(mechanism, np.array(limits_rad, dtype=np.float64))
