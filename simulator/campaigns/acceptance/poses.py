"""Simulated acceptance tests: standards touched by an arm.

`acceptance_poses` finds places and postures once; `touched_by` makes another arm touch
the same spots, and `drawn_acceptance` draws noise and certificates.
"""

from dataclasses import replace

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.arm.inverse import shifted_postures
from traverse.simulator.arm.physics import Mechanism, probe_pose
from traverse.simulator.arm.truth import Deviations, TrueArm, true_arm
from traverse.simulator.campaigns.acceptance.layout import PlacedStandard, layout_of
from traverse.simulator.campaigns.artefacts.artefact import Placement
from traverse.simulator.campaigns.campaign import SimulatedCampaign, StatedArtefact
from traverse.simulator.campaigns.conditions import drawn_conditions, stream
from traverse.simulator.campaigns.drawing import draw_noise
from traverse.simulator.campaigns.pose_set import PlacedArtefact, PoseSet, rigid_fields
from traverse.simulator.campaigns.postures import Workspace, workspace_of
from traverse.simulator.campaigns.siting import UnreachableError
from traverse.simulator.campaigns.spec import CampaignSpec, ConditionTable, NoiseTable

N_PLACES = 80
N_ROUNDS = 4
N_POSTURES = 24  # from which the probe's direction is chosen where it matters


def acceptance_poses(
    arm: Arm,
    standard: str,
    seed: int,
    *,
    noise: NoiseTable | None = None,
    std_mm: float = 0.0005,
) -> PoseSet:
    """Place the artefacts of a standard, and touch them with the arm of the file.

    Equal seeds give equal poses; ``noise`` lies between the truth and the file.

    Raises:
        UnreachableError: an artefact fits nowhere.
    """
    truth = true_arm(arm, Deviations(), seed)
    workspace = workspace_of(truth.mechanism, "full")
    rng = stream(seed, "placement")
    shoulder_mm, reach_mm = _reach(truth.mechanism)
    placed, standings, turns = [], [], []
    for standing in layout_of(standard, reach_mm, truth.radius_mm, std_mm=std_mm):
        placement, turns_rad = _touched(
            standing, workspace, (shoulder_mm, reach_mm), rng
        )
        placed.append(PlacedArtefact(standing.artefact, placement))
        standings.append(standing)
        turns.append(turns_rad)
    turns_rad = np.concatenate(turns)
    table = ConditionTable()
    around = drawn_conditions(
        table, len(turns_rad), truth.mechanism.n_joints, stream(seed, "conditions")
    )
    towards = [
        entry.placement.directions(standing.towards)
        for entry, standing in zip(placed, standings, strict=True)
    ]
    spec = CampaignSpec(
        artefacts=tuple(standing.artefact for standing in standings),
        noise=noise or NoiseTable(),
        conditions=table,
    )
    return PoseSet(
        spec=spec,
        limits_rad=workspace.limits_rad,
        artefacts=tuple(placed),
        artefact_index=np.repeat(
            np.arange(len(standings)), [len(s.features) for s in standings]
        ),
        feature_index=np.concatenate(
            [
                [standing.artefact.features.index(name) for name in standing.features]
                for standing in standings
            ]
        ).astype(np.intp),
        contacts_mm=probe_pose(truth.mechanism, turns_rad)[0],
        around=replace(around, towards=np.concatenate(towards)),
        **rigid_fields(arm, truth, turns_rad),
    )


def touched_by(poses: PoseSet, truth: TrueArm) -> PoseSet:
    """Touch the same spots with another arm, with the least motion of its joints."""
    centres_mm, _ = probe_pose(truth.mechanism, poses.rigid_turns_rad)
    turns_rad = shifted_postures(
        truth.mechanism, poses.rigid_turns_rad, poses.contacts_mm - centres_mm
    )
    return replace(poses, **rigid_fields(poses.arm, truth, turns_rad))


def drawn_acceptance(poses: PoseSet, seed: int) -> SimulatedCampaign:
    """Draw noise, and a certificate for each standard wherever it stands."""
    drawn = draw_noise(poses, seed)
    first: dict[str, StatedArtefact] = {}
    stated = []
    for entry in drawn.campaign.artefacts:
        known = first.setdefault(_standard_of(entry.id), entry)
        stated.append(StatedArtefact(entry.id, entry.kind, known.table))
    return SimulatedCampaign(
        replace(drawn.campaign, artefacts=tuple(stated)), drawn.truth
    )


def _standard_of(name: str) -> str:
    """Return the physical standard: `uni-3-2` and `uni-5-2` are one."""
    kind, _, suffix = name.partition("-")
    if kind == "uni":
        return f"uni-{suffix.rpartition('-')[2]}"
    if kind == "volumetric":
        return "volumetric-short" if int(suffix) <= 10 else "volumetric-long"
    if kind == "spat" or name == "scan-flat":
        return name
    return "bar" if kind == "check" else "sphere"


def _reach(mechanism: Mechanism) -> tuple[Floats, float]:
    """Return the second joint, and the reach of the ball from there."""
    corners_mm = np.vstack([mechanism.origins_mm[1:], mechanism.probe_mm])
    links_mm = np.linalg.norm(np.diff(corners_mm, axis=0), axis=1)
    return corners_mm[0], float(np.sum(links_mm))


def _touched(
    standing: PlacedStandard,
    workspace: Workspace,
    volume: tuple[Floats, float],
    rng: np.random.Generator,
) -> tuple[Placement, Floats]:
    """Find a place, and a posture for every touch, (n, n_joints)."""
    shoulder_mm, reach_mm = volume
    rotation = _rotation(standing.way)
    low, high = standing.zone
    for _ in range(N_PLACES):
        direction = rng.standard_normal(3)
        direction /= np.linalg.norm(direction)
        away_mm = reach_mm * float(rng.uniform(low, high))
        placement = Placement(rotation, shoulder_mm + away_mm * direction)
        centres_mm = placement.points_mm(standing.own_mm)
        farthest_mm = np.max(np.linalg.norm(centres_mm - shoulder_mm, axis=1))
        if farthest_mm > 0.96 * reach_mm:
            continue
        turns_rad, reached = workspace.reaching(centres_mm, rng, N_ROUNDS)
        if np.all(reached):
            if np.all(np.isfinite(standing.shanks)):
                turns_rad = _aligned(standing.shanks, workspace, centres_mm, rng)
            return placement, turns_rad
    raise UnreachableError(
        f"{standing.artefact.kind} '{standing.artefact.id}': the arm reaches all of it "
        f"in none of {N_PLACES} places"
    )


def _aligned(
    shanks: Floats,
    workspace: Workspace,
    centres_mm: Floats,
    rng: np.random.Generator,
) -> Floats:
    """Choose, of many postures for a touch, the one whose probe is best aligned."""
    n = len(centres_mm)
    many = np.repeat(centres_mm, N_POSTURES, axis=0)
    turns_rad, reached = workspace.reaching(many, rng)
    _, shanks_reached = probe_pose(workspace.mechanism, turns_rad)
    likeness = np.einsum(
        "ni,ni->n", shanks_reached, np.repeat(shanks, N_POSTURES, axis=0)
    )
    likeness[~reached] = -2.0
    best = np.argmax(likeness.reshape(n, N_POSTURES), axis=1)
    chosen: Floats = turns_rad[np.arange(n) * N_POSTURES + best]
    return chosen


def _rotation(way: Floats) -> Floats:
    """Return a rotation (3, 3) of the third axis to a direction."""
    least = np.eye(3)[int(np.argmin(np.abs(way)))]
    first = np.cross(least, way)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(way, first), way])
