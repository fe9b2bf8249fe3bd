"""Cone: the ball sits in a seat while the arm articulates around it."""

from functools import partial

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.simulator.arm.inverse import REACHED_MM
from traverse.simulator.arm.physics import probe_pose
from traverse.simulator.arm.trajectory import spline_pieces
from traverse.simulator.motions.motion import Direction, Motion, Vector
from traverse.simulator.motions.stage import CourseBuilder, UnreachableError
from traverse.simulator.motions.surfaces import unit
from traverse.simulator.motions.touching import hard_approach
from traverse.simulator.scenario.script import ScriptEvent

N_KNOTS = 49
N_TRIES = 8
MOST_PLAY_MM = 0.05  # of the ball in its seat between knots
SHORTEST_RAD = 0.3  # of all joints together, else it is hardly another posture
LONGEST_STEP_RAD = 0.4  # between knots; more is a jump to another branch


class Cone(Motion):
    """Press the button in many postures with the ball in one place."""

    artefact: str = "cone"
    seat_mm: Vector
    axis: Direction = (0.0, 0.0, 1.0)
    postures: int = Field(ge=1)

    def play(self, stage: CourseBuilder) -> None:
        axis = unit(self.axis)
        seats_mm = np.tile(np.array(self.seat_mm), (self.postures, 1))
        shanks = np.tile(-axis, (self.postures, 1))
        seated, reached = stage.reach.postures(
            seats_mm, shanks, stage.operator.tilt_rad
        )
        if not np.all(reached):
            raise UnreachableError(
                f"{np.sum(~reached)} of {self.postures} postures were not found with "
                f"the ball at {self.seat_mm} mm; move the seat, or allow the shank to "
                "lean more (operator.tilt_rad)"
            )
        approach = hard_approach(stage)
        targets = seats_mm + approach.distances_mm[:, None, None] * axis
        entries = stage.reach.along(seated, targets[::-1])[::-1]

        def leave() -> None:
            way_rad = stage.reach.path(stage.posture_rad, targets[::-1, 0])
            stage.follow(way_rad, approach.times_s)

        for number in range(self.postures):
            path = _articulation(stage, seats_mm[0], -axis) if number else None
            if path is not None:
                stage.lead(path, stage.operator.move_s)
            else:  # in from outside, as at the beginning
                if number:
                    leave()
                stage.move(entries[0, number], stage.operator.move_s)
                stage.follow(entries[:, number], approach.times_s)
            stage.press(partial(ScriptEvent, artefact=self.artefact))
        leave()


def _articulation(
    stage: CourseBuilder, seat_mm: Floats, shank: Floats
) -> Floats | None:
    """Draw ways to other postures, the ball staying in its seat; take the longest.

    Returns:
        (N_KNOTS, n_joints), or None if every way hits a limit.
    """
    u = np.linspace(0.0, 1.0, N_KNOTS)
    fractions = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    reach, start_rad = stage.reach, stage.posture_rad
    low, high = reach.limits_rad.T
    target_rad = reach.rng.uniform(low, high, (N_TRIES, len(start_rad)))
    pull = reach.rng.uniform(0.3, 1.0, (N_TRIES, 1))
    starts = np.tile(start_rad, (N_TRIES, 1))
    targets_rad = starts + fractions[:, None, None] * (pull * (target_rad - starts))
    ways = reach.nearest(starts, targets_rad, np.tile(seat_mm, (N_TRIES, 1)))
    centres_mm, shanks = probe_pose(reach.mechanism, ways[-1])
    good = np.linalg.norm(centres_mm - seat_mm, axis=1) < REACHED_MM
    good &= shanks @ shank >= np.cos(stage.operator.tilt_rad)
    good &= np.all((ways >= low) & (ways <= high), axis=(0, 2))
    good &= np.max(np.abs(np.diff(ways, axis=0)), axis=(0, 2)) < LONGEST_STEP_RAD
    lengths = np.linalg.norm(ways[-1] - start_rad, axis=1) * good
    for best in np.argsort(-lengths):
        if lengths[best] < SHORTEST_RAD:
            break
        if _stays_seated(stage, ways[:, best], seat_mm):
            return ways[:, best]
    return None


def _stays_seated(stage: CourseBuilder, way_rad: Floats, seat_mm: Floats) -> bool:
    """Check between the knots, where the course is interpolated."""
    pieces = spline_pieces(np.linspace(0.0, 1.0, N_KNOTS), way_rad)
    between = np.einsum("p,npj->nj", 0.5 ** np.arange(6), pieces)
    centres_mm, _ = probe_pose(stage.reach.mechanism, between)
    off_mm = np.linalg.norm(centres_mm - seat_mm, axis=1)
    return bool(np.max(off_mm) < MOST_PLAY_MM)
