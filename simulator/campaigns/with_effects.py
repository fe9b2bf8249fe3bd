"""Plays effects on contacts: the same spots are touched, by an arm that yields."""

from collections.abc import Sequence
from dataclasses import replace

from traverse.kinematics.arm_file.arm import Effect
from traverse.simulator.campaigns.pose_set import PoseSet
from traverse.simulator.effects import Fault, faults_from_effects, on_true_axes
from traverse.simulator.effects.faulty_arm import faulty_arm
from traverse.simulator.effects.from_arm import TIMED
from traverse.strict_toml.problems import FileError, Problem


def with_effects(
    poses: PoseSet, effects: Sequence[Effect], faults: Sequence[Fault] = ()
) -> PoseSet:
    """Touch the same spots with other effects, instead of those that were there.

    Artefacts, contacts and conditions stay. The joints give way as little as they can,
    so that the ball of the arm as it then is touches. Vectors of wobble and runout are
    turned onto the true axes; the effects of the result are those.

    Args:
        poses: With or without effects.
        effects: As an arm file has them.
        faults: What else shall be wrong, also what no arm file can name.

    Raises:
        FileError: Naming all effects that cannot be played.
        MissedContactError: Effects so large that the ball does not reach its spots.
    """
    _refuse_without_time(poses, effects)
    truth, around = poses.truth, poses.around
    effects = on_true_axes(poses.arm, effects, truth.mechanism.axes)
    named = faults_from_effects(poses.arm, effects, "effects of a simulated campaign")
    faulty = faulty_arm(poses.arm, truth.mechanism, truth.zeros_rad, (*named, *faults))
    turns_rad = faulty.touching_turns(poses.rigid_turns_rad, poses.contacts_mm, around)
    return replace(
        poses,
        turns_rad=turns_rad,
        effects=effects,
        faults=tuple(faults),
        faulty=faulty,
    )


def _refuse_without_time(poses: PoseSet, effects: Sequence[Effect]) -> None:
    if poses.spec.conditions.start_utc is not None:
        return
    timed = sorted({effect.kind for effect in effects if effect.kind in TIMED})
    if timed:
        message = (
            f"is missing, but {', '.join(timed)} count from their epoch_utc; say when "
            "the campaign starts"
        )
        problem = Problem("conditions.start_utc", message)
        raise FileError("campaign specification", [problem])
