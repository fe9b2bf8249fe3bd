"""A set of contacts with postures, conditions and effects."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from traverse.arrays import Floats, Indices
from traverse.kinematics.arm_file.arm import Arm, Effect
from traverse.simulator.arm.truth import TrueArm
from traverse.simulator.campaigns.artefacts import Artefact
from traverse.simulator.campaigns.artefacts.artefact import Placement
from traverse.simulator.campaigns.spec import CampaignSpec
from traverse.simulator.effects import (
    Fault,
    FaultyArm,
    Surroundings,
    faults_from_effects,
    on_true_axes,
)
from traverse.simulator.effects.faulty_arm import faulty_arm
from traverse.simulator.effects.from_arm import TIMED
from traverse.strict_toml.problems import FileError, Problem


@dataclass(frozen=True, slots=True)
class PlacedArtefact:
    """An artefact and its place."""

    artefact: Artefact
    placement: Placement

    def true_table(self) -> dict[str, Any]:
        names = {"id": self.artefact.id, "kind": self.artefact.kind}
        return {**names, **self.artefact.true_table(self.placement)}


@dataclass(frozen=True, slots=True)
class PoseSet:
    """Contacts in the order of time; any number of noises can be drawn for them.

    Attributes:
        limits_rad: (n_joints, 2) of the turns.
        artefact_index: (n,) touched artefact.
        feature_index: (n,) touched feature.
        contacts_mm: (n, 3) centre of a ball of the arm file's radius that touches.
        rigid_turns_rad: (n, n_joints) from the base posture, of an arm without effects.
        turns_rad: (n, n_joints) of the arm with effects.
        around: conditions of every contact, and directions towards the material.
        effects: of the true arm, and of standards.
        faults: of the true arm, which no arm file can name.
        faulty: the true arm with both.
    """

    spec: CampaignSpec
    arm: Arm
    truth: TrueArm
    limits_rad: Floats
    artefacts: tuple[PlacedArtefact, ...]
    artefact_index: Indices
    feature_index: Indices
    contacts_mm: Floats
    rigid_turns_rad: Floats
    turns_rad: Floats
    around: Surroundings
    effects: tuple[Effect, ...]
    faults: tuple[Fault, ...]
    faulty: FaultyArm

    @property
    def n_poses(self) -> int:
        return len(self.turns_rad)

    @property
    def readings_rad(self) -> Floats:
        """Readings of the encoders at the contacts, without noise, (n, n_joints)."""
        return self.faulty.readings_rad(self.turns_rad, self.around)

    def length_error(self, artefact: str) -> float:
        """Return by how much of its certified length a standard is longer."""
        errors_ppm = [
            float(effect.values["error_ppm"])
            for effect in self.effects
            if effect.kind == "artefact_length"
            and effect.values["artefact"] == artefact
        ]
        return 1e-6 * sum(errors_ppm)


def rigid_fields(arm: Arm, truth: TrueArm, turns_rad: Floats) -> dict[str, Any]:
    """Return fields of a set without effects, of an arm at turns (n, n_joints)."""
    return {
        "arm": arm,
        "truth": truth,
        "rigid_turns_rad": turns_rad,
        "turns_rad": turns_rad,
        "effects": (),
        "faults": (),
        "faulty": faulty_arm(arm, truth.mechanism, truth.zeros_rad, ()),
    }


def with_effects(
    poses: PoseSet, effects: Sequence[Effect], faults: Sequence[Fault] = ()
) -> PoseSet:
    """Touch the same spots with other effects.

    Artefacts, contacts and conditions stay; the joints move as little as possible.
    Vectors of wobble and runout are turned onto the true axes.

    ``faults`` may be some that no arm file can name.

    Raises:
        FileError: lists all effects that cannot be played.
        MissedContactError: effects so large that the ball does not reach its spots.
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
