"""Check that artefacts fit the arm, and find places within its reach."""

from collections.abc import Iterator, Sequence

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.plurals import counted
from traverse.simulator.arm.physics import probe_pose
from traverse.simulator.campaigns.artefacts import Artefact
from traverse.simulator.campaigns.artefacts.artefact import (
    Placement,
    Touches,
    drawn_rotation,
)
from traverse.simulator.campaigns.conditions import stream
from traverse.simulator.campaigns.postures import Workspace
from traverse.simulator.campaigns.spec import CampaignSpec, mix_artefacts, spec_problems
from traverse.strict_toml.problems import FileError, Problem

N_LOOKS = 1000  # postures that determine the width of the working volume


def spec_artefacts(
    spec: CampaignSpec, workspace: Workspace, seed: int
) -> tuple[Artefact, ...]:
    if spec.mix is None or spec.n_poses is None:
        return spec.artefacts
    width_mm = _width_mm(workspace, stream(seed, "sizes"))
    return mix_artefacts(spec.mix, spec.n_poses, width_mm)


def _width_mm(workspace: Workspace, rng: np.random.Generator) -> float:
    """Return the width of the working volume: three sigma along its thinnest axis.

    At most the stretched arm: wide volumes are hollow.
    """
    mechanism = workspace.mechanism
    places_mm, _ = probe_pose(mechanism, workspace.drawn_turns(N_LOOKS, rng))
    thinnest_mm2 = float(np.linalg.eigvalsh(np.cov(places_mm.T))[0])
    corners_mm = np.vstack([mechanism.origins_mm, mechanism.probe_mm])
    reach_mm = np.sum(np.linalg.norm(np.diff(corners_mm, axis=0), axis=1))
    return float(min(3.0 * np.sqrt(max(thinnest_mm2, 0.0)), reach_mm))


def refuse_misfits(spec: CampaignSpec, arm: Arm, *more_problems: Problem) -> None:
    """Refuse a specification that does not fit an arm.

    Raises:
        FileError: lists all problems.
    """
    if problems := [*_misfits(spec, arm), *more_problems]:
        raise FileError("campaign specification", problems)


def _misfits(spec: CampaignSpec, arm: Arm) -> Iterator[Problem]:
    yield from spec_problems(spec.model_dump(exclude_unset=True))
    joints = [joint.name for joint in arm.joints]
    for key, entries in (
        ("limits_rad", spec.limits_rad),
        ("noise.encoders_rad", spec.noise.encoders_rad),
    ):
        if entries is not None and len(entries) != len(joints):
            message = (
                f"has {counted(len(entries), 'entry')}; the arm has "
                f"{counted(len(joints), 'joint')}, "
                f"{', '.join(joints)}; give one for each"
            )
            yield Problem(key, message)
    bare = [joint.name for joint in arm.joints if joint.encoder is None]
    if spec.noise.quantised and bare:
        message = (
            f"the arm file gives no encoder of {', '.join(bare)}; add its "
            "counts_per_turn there or leave readings unrounded"
        )
        yield Problem("noise.quantised", message)
    for number, artefact in enumerate(spec.artefacts):
        problem = artefact.size_problem(arm.probe.radius_mm)
        if problem is not None:
            yield Problem(f"artefacts[{number}]", problem)


N_SITES = 12  # tried at a time
N_TRIALS = 40
N_HOPELESS = 5  # trials after which one that is nowhere half reached is abandoned
N_CONTACTS = 12  # tried at each, or every feature once
N_ROUNDS = 5  # who needs more starts is at the edge of the working volume
ENOUGH = 0.9  # of contacts that are reached in that many, where spots can be chosen


class UnreachableError(ValueError):
    """An artefact that the arm cannot reach; make it smaller or the limits wider."""


def place_artefacts(
    artefacts: Sequence[Artefact],
    workspace: Workspace,
    ball_mm: float,
    rng: np.random.Generator,
) -> tuple[Placement, ...]:
    """Place artefacts, one after the other.

    Among the sites that can be touched in varied postures, one far from the others is
    taken, so that they spread over the working volume.

    Raises:
        UnreachableError: one fits nowhere; states the best attempt.
    """
    placed: list[Placement] = []
    for artefact in artefacts:
        taken_mm = np.array([site.position_mm for site in placed]).reshape(-1, 3)
        placed.append(_site(artefact, taken_mm, rng, workspace, ball_mm))
    return tuple(placed)


def _site(
    artefact: Artefact,
    taken_mm: Floats,
    rng: np.random.Generator,
    workspace: Workspace,
    ball_mm: float,
) -> Placement:
    best_share, needed_share = 0.0, 1.0 if artefact.IS_FIXED else ENOUGH
    n_sites = 0
    for trial in range(N_TRIALS):
        if trial >= N_HOPELESS and best_share < 0.5:
            break
        n_sites += N_SITES
        drawn_rad = workspace.drawn_turns(N_SITES, rng)
        at_mm, _ = probe_pose(workspace.mechanism, drawn_rad)
        sites = [Placement(drawn_rotation(rng), position_mm) for position_mm in at_mm]
        targets_mm = np.concatenate(
            [site.points_mm(_trial_contacts(artefact, ball_mm, rng)) for site in sites]
        )
        turns_rad, reached = workspace.reaching(targets_mm, rng, N_ROUNDS)
        shares = np.mean(reached.reshape(N_SITES, -1), axis=1)
        best_share = max(best_share, float(np.max(shares)))
        turns_rad[~reached] = np.nan
        good = np.flatnonzero(shares >= needed_share)
        if len(good):
            postures = turns_rad.reshape(N_SITES, -1, turns_rad.shape[1])[good]
            variety = np.mean(np.nanstd(postures, axis=1), axis=1)
            worth = variety * _distances_mm(at_mm[good], taken_mm)
            return sites[int(good[np.argmax(worth)])]
    raise UnreachableError(
        f"{artefact.kind} '{artefact.id}': of {n_sites} places the best "
        f"lets the arm reach {best_share:.0%} of it within its joint limits, expected "
        f"{needed_share:.0%}; make it smaller, or the limits wider"
    )


def _trial_contacts(
    artefact: Artefact, ball_mm: float, rng: np.random.Generator
) -> Floats:
    """Return ball centres (n, 3) on all features, in the artefact's coordinates."""
    n_features = len(artefact.features)
    features = np.arange(max(N_CONTACTS, n_features)) % n_features
    growths = np.ones(len(features))
    return artefact.contacts(Touches(rng, features, ball_mm, growths)).centres_mm


def _distances_mm(at_mm: Floats, taken_mm: Floats) -> Floats:
    """Return distances (n,) of places (n, 3) to the nearest of (m, 3); 1 if none."""
    if len(taken_mm) == 0:
        return np.ones(len(at_mm))
    gaps_mm = np.linalg.norm(at_mm[:, None] - taken_mm, axis=2)
    nearest: Floats = np.min(gaps_mm, axis=1)
    return nearest
