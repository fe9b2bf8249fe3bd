"""Touches surfaces, with a hard probe and a button or with a switching probe."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.plurals import counted
from traverse.simulator.motions.stage import CourseBuilder, IsClear, UnreachableError
from traverse.simulator.scenario.script import ScriptEvent

N_APPROACH_KNOTS = 17
N_SWITCH_KNOTS = 8  # in each of the four parts of a way


@dataclass(frozen=True, slots=True)
class Contact:
    """A place on a surface.

    Attributes:
        surface_mm: (3,)
        normal: (3,) out of the material.
    """

    artefact: str
    feature: str
    surface_mm: Floats
    normal: Floats

    def change(self, time_s: float, input_name: str, level: int) -> ScriptEvent:
        """Return a change of an input while the ball is here."""
        return ScriptEvent(
            time_s,
            input_name,
            level,
            self.artefact,
            self.feature,
            _triple(self.surface_mm),
            _triple(self.normal),
        )


@dataclass(frozen=True, slots=True)
class Approach:
    """Distances from the contact over time; the way back is the same reversed.

    Attributes:
        times_s: (n,) from 0.
        distances_mm: (n,) along the normal, the clearance first.
        contact: index of the knot with distance 0.
    """

    times_s: Floats
    distances_mm: Floats
    contact: int


def touch(stage: CourseBuilder, contacts: list[Contact], is_clear: IsClear) -> None:
    """Go to every contact in turn.

    ``is_clear`` returns whether balls at places (n, 3) are off the surface.

    Raises:
        UnreachableError: names the contacts that cannot be reached.
    """
    postures = solve_contacts(stage, contacts)
    approach = _switch_approach(stage) if stage.switching else hard_approach(stage)
    paths = _paths(stage, approach, postures, contacts)
    for contact, path in zip(contacts, paths, strict=True):
        stage.move_clear(path[0], is_clear)
        if stage.switching:
            _touch_with_switch(stage, contact, approach, path)
        else:
            stage.follow(path, approach.times_s)
            stage.press(contact.change)
            stage.follow(path[::-1], approach.times_s)


def solve_contacts(stage: CourseBuilder, contacts: list[Contact]) -> Floats:
    """Find postures (n, n_joints) with the ball exactly in contact.

    Raises:
        UnreachableError: names the contacts that cannot be reached.
    """
    centres_mm, normals = _ball_places(stage, contacts)
    postures, reached = stage.reach.postures(
        centres_mm, -normals, stage.operator.tilt_rad
    )
    if not np.all(reached):
        missed = [_shown(centres_mm[i]) for i in np.flatnonzero(~reached)]
        raise UnreachableError(
            f"{len(missed)} of {counted(len(contacts), 'contact')} cannot be reached: "
            f"ball centres {', '.join(missed[:4])} mm; bring them nearer, or allow the "
            "shank to lean more (operator.tilt_rad)"
        )
    return postures


def _touch_with_switch(
    stage: CourseBuilder, contact: Contact, approach: Approach, path: Floats
) -> None:
    times_s = approach.times_s
    back_s = times_s[-1] - times_s[::-1]
    closed_s = stage.time_s + float(times_s[approach.contact])
    stage.follow(path, times_s)
    opened_s = stage.time_s + float(back_s[len(back_s) - 1 - approach.contact])
    stage.follow(path[::-1], back_s)
    stage.events.append(contact.change(closed_s, "switch", 1))
    stage.events.append(contact.change(opened_s, "switch", 0))


def hard_approach(stage: CourseBuilder) -> Approach:
    """Stop exactly in contact, with least jerk."""
    u = np.linspace(0.0, 1.0, N_APPROACH_KNOTS)
    share = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    return Approach(
        stage.operator.approach_s * u,
        stage.operator.clearance_mm * (1.0 - share),
        N_APPROACH_KNOTS - 1,
    )


def _switch_approach(stage: CourseBuilder) -> Approach:
    """Speed up, cross the contact at constant speed, brake beyond.

    Half the clearance and half the overtravel are crossed at constant speed.
    """
    speed = stage.operator.switch_speed_mm_s
    half_mm, past_mm = (
        0.5 * stage.operator.clearance_mm,
        0.5 * stage.operator.overtravel_mm,
    )
    u = np.linspace(0.0, 1.0, N_SWITCH_KNOTS + 1)
    lengths_s = np.array([2.0 * half_mm, half_mm, past_mm, 2.0 * past_mm]) / speed
    starts_s = np.concatenate([[0.0], np.cumsum(lengths_s)])
    distances_mm = [
        2.0 * half_mm - half_mm * u**2,
        half_mm * (1.0 - u),
        -past_mm * u,
        -past_mm * (1.0 + 2.0 * u - u**2),
    ]
    times_s = [starts_s[i] + lengths_s[i] * u[1:] for i in range(4)]
    return Approach(
        np.concatenate([[0.0], *times_s]),
        np.concatenate([[2.0 * half_mm], *(d[1:] for d in distances_mm)]),
        2 * N_SWITCH_KNOTS,
    )


def _paths(
    stage: CourseBuilder,
    approach: Approach,
    postures: Floats,
    contacts: list[Contact],
) -> Floats:
    """Return postures (n_contacts, n_knots, n_joints), exact at the contact."""
    centres_mm, normals = _ball_places(stage, contacts)
    targets = centres_mm + approach.distances_mm[:, None, None] * normals
    contact = approach.contact
    outwards = stage.reach.along(postures, targets[contact::-1])[::-1]
    inwards = stage.reach.along(postures, targets[contact + 1 :])
    return np.concatenate([outwards, inwards]).transpose(1, 0, 2)


def _ball_places(
    stage: CourseBuilder, contacts: list[Contact]
) -> tuple[Floats, Floats]:
    """Return ball centres in contact and normals, (n, 3) each."""
    normals = np.array([contact.normal for contact in contacts])
    surfaces_mm = np.array([contact.surface_mm for contact in contacts])
    return surfaces_mm + stage.radius_mm * normals, normals


def _triple(vector: Floats) -> tuple[float, float, float]:
    x, y, z = (float(component) for component in vector)
    return x, y, z


def _shown(vector: Floats) -> str:
    return "(" + ", ".join(f"{component:.0f}" for component in vector) + ")"
