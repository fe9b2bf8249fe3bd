"""Further poses that separate two effects best (T-optimality).

An effect does y to the equations. Another can be told from it by as much as it cannot
imitate, the unknowns X of the model and the other's amplitudes adjusted,

    Delta = min over b of |y - X b|^2

and is taken for it with the chance Phi(-sqrt(Delta) / 2). Poses are added one by one,
each time the one that raises Delta most, by e^T (I + X_p N^-1 X_p^T)^-1 e for its
misclosures e (Atkinson and Fedorov); of several others, for the one that lacks most.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from scipy import special

from traverse.arrays import Floats, Integers
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment import Adjustment, adjust
from traverse.lab.artefacts.artefact import postures_touching
from traverse.lab.campaign.poses import Poses
from traverse.lab.diagnosis.candidates.library import library_bank
from traverse.lab.diagnosis.candidates.steps import step_columns
from traverse.lab.diagnosis.candidates.waves import harmonic_bank, wave_columns
from traverse.lab.diagnosis.model.candidate import Bank
from traverse.lab.diagnosis.model.fit import rows_without
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    equations_of,
)
from traverse.lab.diagnosis.model.serial_noise import rows_by_pose
from traverse.lab.outcomes.candidate import BankName, Candidate


def further_contacts(
    adjustment: Adjustment, n_tries: int, seed: int, wider_rad: Floats
) -> Poses:
    """Draw postures that touch the fit's artefacts.

    So many of every artefact; those that do not reach it fall away. Each joint may go
    beyond either end of what it has travelled, (n_joints,). What else a pose says
    (time, temperature, motion, force) is taken from a random pose of the same
    artefact; the direction of a surface is its normal.
    """
    rng = np.random.default_rng(seed)
    network = adjustment.network
    travelled_rad = network.campaign.poses.angles_rad[network.poses]
    limits_rad = np.stack(
        [travelled_rad.min(axis=0) - wider_rad, travelled_rad.max(axis=0) + wider_rad]
    )
    contacts = [
        _contacts(adjustment, index, limits_rad, n_tries, rng)
        for index in range(len(network.stations))
    ]
    return joined_poses(contacts, network.campaign.poses)


def joined_poses(parts: list[Poses], like: Poses) -> Poses:
    """Put poses one after the other, with the columns that `like` has."""
    columns: dict[str, Any] = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts])
        for field in fields(Poses)
        if getattr(like, field.name) is not None
    }
    return Poses(**columns)


def extended_rows(adjustment: Adjustment, further: Poses) -> ObservationEquations:
    """Set up the rows of a fit, where it is, as if further poses had taken part.

    The campaign's own poses are the first.
    """
    network = adjustment.network
    poses = joined_poses([network.campaign.poses, further], network.campaign.poses)
    campaign = replace(network.campaign, poses=poses)
    included = np.append(network.included, np.ones(len(further), dtype=np.bool_))
    everyone = network.stations_of(included, campaign)
    weights = np.ones(len(poses))
    wider = replace(network, campaign=campaign, stations=everyone, weights=weights)
    n_corrected = network.parameters.n_joints + 6
    nothing = tuple(np.zeros((len(s.poses), n_corrected)) for s in everyone)
    state = replace(adjustment.state, corrections=nothing)
    return equations_of(adjust(wider, state, state.arm, None, 0))


def _contacts(
    adjustment: Adjustment,
    at: int,
    limits_rad: Floats,
    n_tries: int,
    rng: np.random.Generator,
) -> Poses:
    network, state = adjustment.network, adjustment.state
    station, geometry = network.stations[at], state.arm.geometry
    like = rng.integers(len(station.poses), size=n_tries)
    part = station.part(like)
    size = n_tries, limits_rad.shape[1]
    tries_rad = rng.uniform(limits_rad[0], limits_rad[1], size)
    came = postures_touching(
        part.artefact,
        state.unknowns[at],
        part.touches,
        geometry,
        tries_rad,
        limits_rad=limits_rad,
    )
    poses = network.campaign.poses.part(part.poses)
    if poses.tools is not None:  # advice is for the arm's own
        poses = replace(poses, tools=np.zeros_like(poses.tools))
    poses = replace(poses, angles_rad=came.angles_rad)
    if poses.orientations is not None:  # nobody has measured them
        nowhere = np.full_like(poses.orientations, np.nan)
        poses = replace(poses, orientations=nowhere)
    if poses.directions is not None and part.artefact.rows_per_pose == 1:
        normals = came.equations.by_centre[:, 0]
        before = station.artefact.equations(
            state.unknowns[at],
            network.centres_mm(station, state.arm),
            station.touches,
        ).by_centre[like, 0]
        along = np.sum(before * poses.directions, axis=1, keepdims=True)
        poses = replace(poses, directions=np.sign(along) * normals)
    return poses.part(came.is_touching)


_SEED = 7
_MOST_CONTACTS = 360
# Fewer could not contradict a blunder among them.
_LEAST_POSES = 5
# What a combination of unknowns must do to the data to count; the banks' limit.
_LEAST_EFFECT = 0.016


@dataclass(frozen=True, slots=True, eq=False)
class Experiment:
    """Further poses that separate an effect from others, the best first.

    Attributes:
        poses: What to touch and how, (n_poses,).
        separations: Delta from each other effect, now and after each pose,
            (n_poses + 1, n_others).
        is_enough: Whether all grow by the required amount.
    """

    poses: Poses
    separations: Floats
    is_enough: bool

    @property
    def chances(self) -> Floats:
        """Of taking another effect for this one, (n_poses + 1, n_others)."""
        chances: Floats = special.ndtr(-0.5 * np.sqrt(self.separations))
        return chances


def experiment(
    effects: tuple[Candidate, ...],
    amplitudes: Floats,
    rows: ObservationEquations,
    arm: Arm,
    *,
    gains: Sequence[float],
    index: int | None = None,
    wider_rad: Floats | float = 0.0,
    n_most: int = 40,
) -> Experiment | None:
    """Choose poses on the campaign's artefacts; None: an effect has no columns there.

    The first of the effects is there, with its amplitudes in the unit of its keys,
    (n_columns,), and the others are to be excluded: each Delta is to grow by its gain.
    Index is that of the first one among the effects of the fit's arm, if it is one.
    Joints may go beyond what they have travelled by as much as is given, (n_joints,)
    or one number.
    """
    adjustment = rows.adjustment
    n_tries = _MOST_CONTACTS // len(adjustment.network.stations)
    beyond_rad = np.broadcast_to(wider_rad, adjustment.network.parameters.n_joints)
    further = further_contacts(adjustment, n_tries, _SEED, beyond_rad)
    wider = extended_rows(adjustment, further)
    blocks = _blocks(wider, arm, effects)
    if blocks is None:
        return None
    signal = blocks[0] @ (amplitudes / np.array(effects[0].scales))
    unknowns = (wider if index is None else rows_without(wider, index)).columns
    n_measured = len(adjustment.network.campaign.poses)
    contests = [
        _Contest(signal, np.hstack([unknowns, block]), wider.poses - n_measured, gain)
        for block, gain in zip(blocks[1:], gains, strict=True)
    ]
    chosen: list[int] = []
    while len(chosen) < min(n_most, len(further)) and (
        len(chosen) < _LEAST_POSES or any(contest.lacking > 0.0 for contest in contests)
    ):
        worst = max(contests, key=lambda contest: contest.lacking)
        growths = worst.growths()
        growths[chosen] = -1.0
        chosen.append(int(np.argmax(growths)))
        for contest in contests:
            contest.add(chosen[-1])
    separations = np.array([contest.separations for contest in contests]).T
    return Experiment(
        further.part(np.array(chosen, dtype=np.int64)),
        np.maximum(separations, 0.0),
        all(contest.lacking <= 0.0 for contest in contests),
    )


def _blocks(
    rows: ObservationEquations, arm: Arm, effects: tuple[Candidate, ...]
) -> list[Floats] | None:
    """Compute the columns of effects in units of their scales."""
    banks: dict[BankName, Bank] = {}
    blocks = []
    for effect in effects:
        if effect.at_s is not None:
            blocks.append(step_columns(rows, effect.joint, effect.at_s))
            continue
        if effect.bank is BankName.TRANSMISSION and effect.cycles is not None:
            cycles = np.array([effect.cycles])
            blocks.append(wave_columns(rows, str(effect.joint), cycles))
            continue
        if effect.bank is BankName.GENERIC:
            return None
        if effect.bank not in banks:
            in_library = effect.bank is BankName.LIBRARY
            banks[effect.bank] = (
                library_bank(rows, arm) if in_library else harmonic_bank(rows)
            )
        bank = banks[effect.bank]
        places = [
            part
            for candidate, part in zip(bank.candidates, bank.slices, strict=True)
            if candidate.identity == effect.identity
        ]
        if not places:
            return None
        blocks.append(bank.columns[:, places[0]])
    return blocks


class _Contest:
    """An effect against another one: Delta while poses are added.

    Args:
        own: y of the one, (n_rows,).
        columns: X with the other, (n_rows, n_columns).
        numbers: Of each row's further pose; below 0: measured already, (n_rows,).
        gain: By how much Delta is to grow.
    """

    def __init__(
        self, signal: Floats, columns: Floats, numbers: Integers, gain: float
    ) -> None:
        measured = numbers < 0
        _, values, turned = np.linalg.svd(columns[measured], full_matrices=False)
        # Unknowns of unit variance: N is the unit matrix before anything is added.
        columns = columns @ (turned.T / np.sqrt(values**2 + _LEAST_EFFECT**2))
        self._inverse = np.eye(columns.shape[1])
        self._best = columns[measured].T @ signal[measured]
        left = signal[measured] - columns[measured] @ self._best
        self.separations = [float(signal[measured] @ left)]
        self._gain = gain
        self._columns = rows_by_pose(numbers, columns)
        self._own = rows_by_pose(numbers, signal)

    @property
    def lacking(self) -> float:
        """The part of the required growth that is still missing."""
        return 1.0 - (self.separations[-1] - self.separations[0]) / self._gain

    def growths(self) -> Floats:
        """Compute by how much each further pose raises Delta, (n_poses,)."""
        covariances = self._columns @ self._inverse @ self._columns.swapaxes(1, 2)
        covariances = covariances + np.eye(self._own.shape[1])
        misses = (self._own - self._columns @ self._best)[:, :, np.newaxis]
        solved = np.linalg.solve(covariances, misses)
        growths: Floats = np.sum(misses * solved, axis=(1, 2))
        return growths

    def add(self, pose: int) -> None:
        part = self._columns[pose]
        across = self._inverse @ part.T
        weights = np.linalg.inv(np.eye(len(part)) + part @ across)
        misses = self._own[pose] - part @ self._best
        growth = float(misses @ weights @ misses)
        self.separations.append(self.separations[-1] + growth)
        self._best = self._best + across @ (weights @ misses)
        self._inverse = self._inverse - across @ weights @ across.T
