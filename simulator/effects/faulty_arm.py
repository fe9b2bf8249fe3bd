"""An arm with faults: turns in, readings and places of the ball out."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.arm.physics import Mechanism, centre_rates
from traverse.simulator.effects.fault import (
    BodyFault,
    Fault,
    JointState,
    ReadingFault,
    Touch,
    TouchFault,
)
from traverse.simulator.effects.laws import (
    BODY_LAWS,
    OF_MASSES,
    READING_LAWS,
    TOUCH_LAWS,
)
from traverse.simulator.effects.posture import (
    Build,
    Deflection,
    Posture,
    Surroundings,
    build_of,
    deflected_motion,
    no_yielding,
)

N_LOOKS = 12  # for a reading; each look is 1e-3 of the last one off, or better
SAME_RAD = 1e-15
N_STEPS = 12
TOLERANCE_MM = 1e-10
DAMPING_MM = 1e-6
N_LED_STEPS = 3
LED_DAMPING_MM = 1.0  # a stretched arm continues without being exact


class MissedContactError(ValueError):
    """The ball misses its place because of faults."""


@dataclass(frozen=True, slots=True)
class FaultyArm:
    """The true arm with its faults."""

    build: Build
    readings: tuple[tuple[slice, Callable[[JointState], Floats]], ...]
    bodies: tuple[Callable[[Posture, Deflection], None], ...]
    touches: tuple[Callable[[Touch], Floats], ...]

    @property
    def is_stiff(self) -> bool:
        """Whether the ball is in the place of the rigid arm."""
        return not self.bodies and not self.touches

    def readings_rad(self, turns_rad: Floats, around: Surroundings) -> Floats:
        """Return readings at true turns of the hinges, (n, n_joints).

        Errors depend on the reading: solved by iteration.
        """
        turns_rad = self.build.encoders_of(turns_rad)
        perfect_rad = turns_rad + self.build.zeros_rad
        if not self.readings:
            return perfect_rad
        shown_rad = perfect_rad
        for _ in range(N_LOOKS):
            state = JointState(self.build, turns_rad, shown_rad, around)
            errors_rad = np.zeros_like(perfect_rad)
            for joints, excess_rad in self.readings:
                errors_rad[:, joints] += excess_rad(state)
            before_rad, shown_rad = shown_rad, perfect_rad + errors_rad
            if np.max(np.abs(shown_rad - before_rad), initial=0.0) <= SAME_RAD:
                break
        return shown_rad

    def balls_mm(self, turns_rad: Floats, around: Surroundings) -> Floats:
        """Return positions (n, 3) [mm] of the ball, as defined by touching material.

        That is the centre of a ball of the arm file's radius with the same contact.
        """
        return self.probe(turns_rad, around)[0]

    def probe(self, turns_rad: Floats, around: Surroundings) -> tuple[Floats, Floats]:
        """The ball (n, 3), as in `balls_mm`, and where the shank points, (n, 3)."""
        motion = self._motion(turns_rad, around)
        mechanism = self.build.mechanism
        ends_mm: Floats = motion[:, :3, :3] @ mechanism.probe_mm + motion[:, :3, 3]
        if self.touches:
            towards = np.nan_to_num(around.towards)  # zero where nothing is touched
            touch = Touch(self.build, motion, towards, around.force_n)
            for offsets_mm in self.touches:
                ends_mm = ends_mm - offsets_mm(touch)
        return ends_mm, motion[:, :3, :3] @ mechanism.shank

    def last_body(self, turns_rad: Floats, around: Surroundings) -> Floats:
        """Return the rotation of the last element from the base posture, (n, 3, 3)."""
        return self._motion(turns_rad, around)[:, :3, :3]

    def touching_turns(
        self, turns_rad: Floats, balls_mm: Floats, around: Surroundings
    ) -> Floats:
        """Move the ball to places (n, 3) that the rigid arm reaches at given turns.

        The joints move least. The rigid arm's derivatives serve for all steps, since
        faults are small.

        Raises:
            MissedContactError: faults are not small.
        """
        if self.is_stiff or len(turns_rad) == 0:
            return turns_rad
        gains = self._gains(turns_rad, DAMPING_MM)
        moved_rad = turns_rad
        for _ in range(N_STEPS):
            misses_mm = balls_mm - self.balls_mm(moved_rad, around)
            worst_mm = float(np.max(np.abs(misses_mm)))
            if worst_mm < TOLERANCE_MM:
                return moved_rad
            moved_rad = moved_rad + np.einsum("nij,nj->ni", gains, misses_mm)
        raise MissedContactError(
            f"effects keep the ball {worst_mm:g} mm off a contact after {N_STEPS} "
            "corrections of the posture; make them smaller, or the limits narrower"
        )

    def led_turns(
        self, turns_rad: Floats, balls_mm: Floats, around: Surroundings
    ) -> Floats:
        """Move the ball nearly there, in a constant number of steps.

        Samples do not depend on each other, and singular postures do no harm.
        """
        gains = self._gains(turns_rad, LED_DAMPING_MM)
        for _ in range(N_LED_STEPS):
            misses_mm = balls_mm - self.balls_mm(turns_rad, around)
            turns_rad = turns_rad + np.einsum("nij,nj->ni", gains, misses_mm)
        return turns_rad

    def _gains(self, turns_rad: Floats, damping_mm: float) -> Floats:
        """Return least turns that compensate for a miss, (n, n_joints, 3) [rad/mm]."""
        _, rates = centre_rates(self.build.mechanism, turns_rad)
        back = rates.transpose(0, 2, 1)
        gains: Floats = back @ np.linalg.inv(rates @ back + damping_mm**2 * np.eye(3))
        return gains

    def _motion(self, turns_rad: Floats, around: Surroundings) -> Floats:
        """Return the motion of the last element, (n, 4, 4)."""
        yielding = no_yielding(*turns_rad.shape)
        posture = Posture(self.build, turns_rad, around)
        for move in self.bodies:
            move(posture, yielding)
        return deflected_motion(self.build, turns_rad, yielding)


def faulty_arm(
    arm: Arm, mechanism: Mechanism, zeros_rad: Floats, faults: Iterable[Fault]
) -> FaultyArm:
    readings, bodies, touches = [], [], []
    first_moments_kg_m = np.zeros((len(arm.joints), 3))
    for fault in faults:
        if isinstance(fault, ReadingFault):
            readings.append((fault.joints, fault.errors_rad))
        elif isinstance(fault, BodyFault):
            bodies.append(fault.move)
        elif isinstance(fault, TouchFault):
            touches.append(fault.offsets_mm)
        elif fault.kind == OF_MASSES:
            first_moments_kg_m[fault.joint] += fault.array("moment_kg_m")
        elif fault.kind in READING_LAWS:
            readings.append((fault.joints, partial(READING_LAWS[fault.kind], fault)))
        elif fault.kind in BODY_LAWS:
            bodies.append(partial(BODY_LAWS[fault.kind], fault))
        else:
            touches.append(partial(TOUCH_LAWS[fault.kind], fault))
    build = build_of(arm, mechanism, zeros_rad, first_moments_kg_m)
    return FaultyArm(build, tuple(readings), tuple(bodies), tuple(touches))
