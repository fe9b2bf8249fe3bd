"""Contacts before any noise."""

from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats, Indices
from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.arm.physics import probe_pose
from traverse.simulator.arm.truth import TrueArm, true_arm
from traverse.simulator.campaigns.artefacts import Artefact
from traverse.simulator.campaigns.artefacts.artefact import (
    REFERENCE_C,
    Contacts,
    Touches,
)
from traverse.simulator.campaigns.conditions import drawn_conditions, stream
from traverse.simulator.campaigns.pose_set import (
    PlacedArtefact,
    PoseSet,
    rigid_fields,
    with_effects,
)
from traverse.simulator.campaigns.postures import Workspace, workspace_of
from traverse.simulator.campaigns.siting import (
    UnreachableError,
    place_artefacts,
    refuse_misfits,
    spec_artefacts,
)
from traverse.simulator.campaigns.spec import CampaignSpec
from traverse.simulator.effects import Surroundings

N_REDRAWS = 12  # of contacts that are out of reach


def make_poses(
    arm: Arm, spec: CampaignSpec, seed: int, truth: TrueArm | None = None
) -> PoseSet:
    """Draw the true arm, place the artefacts, touch them.

    The effects of the arm file are played. Equal seeds give equal poses; a given
    ``truth`` is not drawn.

    Raises:
        FileError: lists everything in the specification that does not fit the arm, or
            all effects that cannot be played.
        UnreachableError: something cannot be reached.
    """
    refuse_misfits(spec, arm)
    if truth is None:
        truth = true_arm(arm, spec.deviations, seed)
    workspace = workspace_of(truth.mechanism, spec.travel, spec.limits_rad)
    artefacts = spec_artefacts(spec, workspace, seed)
    placements = place_artefacts(
        artefacts, workspace, truth.radius_mm, stream(seed, "placement")
    )
    artefact_index, feature_index = _touched(artefacts, spec.conditions.visits)
    around = drawn_conditions(
        spec.conditions,
        len(artefact_index),
        truth.mechanism.n_joints,
        stream(seed, "conditions"),
    )
    placed = tuple(map(PlacedArtefact, artefacts, placements))
    touching = _Touching(placed, artefact_index, feature_index, around, truth)
    turns_rad, towards = touching.postures(workspace, stream(seed, "contacts"))
    rigid = PoseSet(
        spec=spec,
        limits_rad=workspace.limits_rad,
        artefacts=placed,
        artefact_index=artefact_index,
        feature_index=feature_index,
        contacts_mm=probe_pose(truth.mechanism, turns_rad)[0],
        around=replace(around, towards=towards),
        **rigid_fields(arm, truth, turns_rad),
    )
    return with_effects(rigid, arm.effects) if arm.effects else rigid


def _touched(artefacts: tuple[Artefact, ...], n_visits: int) -> tuple[Indices, Indices]:
    """Return the order of artefacts and features (n,) in n_visits rounds."""
    counts = np.array([artefact.n_poses for artefact in artefacts])
    visits = []
    for visit in range(n_visits):
        done, next_ = visit * counts // n_visits, (visit + 1) * counts // n_visits
        visits.append(np.repeat(np.arange(len(artefacts)), next_ - done))
    artefact_index = np.concatenate(visits)
    feature_index = np.empty_like(artefact_index)
    for number, artefact in enumerate(artefacts):
        touches = np.arange(artefact.n_poses) % len(artefact.features)
        feature_index[artefact_index == number] = touches
    return artefact_index, feature_index


@dataclass(frozen=True, slots=True)
class _Touching:
    artefacts: tuple[PlacedArtefact, ...]
    artefact_index: Indices
    feature_index: Indices
    around: Surroundings
    truth: TrueArm

    def postures(
        self, workspace: Workspace, rng: np.random.Generator
    ) -> tuple[Floats, Floats]:
        n_poses = len(self.artefact_index)
        turns_rad = np.empty((n_poses, self.truth.mechanism.n_joints))
        towards = np.empty((n_poses, 3))
        missing: Indices = np.arange(n_poses)
        for _ in range(N_REDRAWS):
            contacts = self._contacts(missing, rng)
            solved_rad, reached = workspace.reaching(contacts.centres_mm, rng)
            turns_rad[missing[reached]] = solved_rad[reached]
            towards[missing[reached]] = contacts.towards[reached]
            missing = missing[~reached]
            if len(missing) == 0:
                return turns_rad, towards
        raise UnreachableError(self._missed(missing))

    def _contacts(self, rows: Indices, rng: np.random.Generator) -> Contacts:
        """Draw contacts of some rows, in the arm's system."""
        centres_mm, towards = np.empty((len(rows), 3)), np.empty((len(rows), 3))
        for number, placed in enumerate(self.artefacts):
            on_artefact = np.flatnonzero(self.artefact_index[rows] == number)
            warmer_c = self.around.temperature_c[rows[on_artefact]] - REFERENCE_C
            contacts = placed.artefact.contacts(
                Touches(
                    rng,
                    self.feature_index[rows[on_artefact]],
                    self.truth.radius_mm,
                    1.0 + placed.artefact.thermal_growth_per_c * warmer_c,
                )
            )
            centres_mm[on_artefact] = placed.placement.points_mm(contacts.centres_mm)
            towards[on_artefact] = placed.placement.directions(contacts.towards)
        return Contacts(centres_mm, towards)

    def _missed(self, rows: Indices) -> str:
        lines = []
        for number, placed in enumerate(self.artefacts):
            count = int(np.sum(self.artefact_index[rows] == number))
            if count:
                name = f"{placed.artefact.kind} '{placed.artefact.id}'"
                of = placed.artefact.n_poses
                lines.append(f"{name}: {count} of {of} contacts are out of reach")
        return "; ".join(lines) + "; take another seed, or make it smaller"
