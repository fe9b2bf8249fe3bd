"""Which further poses tell two effects apart best (T-optimality).

An effect does y to the equations. Another can be told from it by as much as it cannot
imitate, the unknowns X of the model and the other's amplitudes adjusted,

    Delta = min over b of |y - X b|^2

and is taken for it with the chance Phi(-sqrt(Delta) / 2). Poses are added one by one,
each time the one that raises Delta most, by e^T (I + X_p N^-1 X_p^T)^-1 e for its
misclosures e (Atkinson and Fedorov).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special  # type: ignore[import-untyped] # scipy ships no types

from kinematics.arm_file import Arm
from lab.campaign import Poses
from lab.diagnosis.candidate import Bank, BankName, Candidate
from lab.diagnosis.contacts import extended_rows, further_contacts
from lab.diagnosis.harmonics import harmonic_bank
from lab.diagnosis.library import library_bank
from lab.diagnosis.rows import Rows
from lab.diagnosis.steps import step_columns
from lab.diagnosis.terms import rows_without

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_SEED = 7
_MOST_CONTACTS = 360
# What a combination of unknowns must do to the data to count; the banks' limit.
_LEAST_EFFECT = 0.016


@dataclass(frozen=True, slots=True, eq=False)
class Experiment:
    """Further poses that tell an effect from another, the best first.

    Attributes:
        poses: What to touch and how, (n_poses,).
        separations: Delta now and after each pose, (n_poses + 1,).
        is_enough: Whether Delta grows by what was wanted.
    """

    poses: Poses
    separations: Floats
    is_enough: bool

    @property
    def chances(self) -> Floats:
        """Of taking one effect for the other, now and later, (n_poses + 1,)."""
        found: Floats = special.ndtr(-0.5 * np.sqrt(self.separations))
        return found


@dataclass(frozen=True, slots=True, eq=False)
class _Contest:
    """The equations of two effects: what is there, and what is tried instead.

    Attributes:
        own: y, (n_rows,).
        columns: X, (n_rows, n_columns).
        poses: Of the rows, (n_rows,).
        n_measured: Poses that were measured; those after them are further ones.
        further: All further poses.
    """

    own: Floats
    columns: Floats
    poses: Integers
    n_measured: int
    further: Poses


def experiment(
    effects: tuple[Candidate, Candidate],
    amplitudes: Floats,
    rows: Rows,
    arm: Arm,
    *,
    index: int | None = None,
    wider_rad: Floats | float = 0.0,
    gain: float = 21.0,
    n_most: int = 40,
) -> Experiment | None:
    """Choose poses on the campaign's artefacts.

    Args:
        effects: What is there, and what is to be excluded.
        amplitudes: Of the first, in the unit of its keys, (n_columns,).
        rows: Of a fit.
        arm: For the columns of effects.
        index: Of the first effect among those of the fit's arm, if it is one.
        wider_rad: By how much joints may go beyond what they have travelled,
            (n_joints,) or one number.
        gain: Of Delta; enough poses for that are chosen.
        n_most: Poses at most.

    Returns:
        None where an effect has no columns at other poses.
    """
    adjustment = rows.adjustment
    n_tries = _MOST_CONTACTS // len(adjustment.network.stations)
    wider = np.broadcast_to(wider_rad, adjustment.network.parameters.n_joints)
    further = further_contacts(adjustment, n_tries, _SEED, wider)
    contest = _contest(effects, amplitudes, (rows, further), arm, index)
    return None if contest is None else _chosen(contest, gain, n_most)


def _contest(
    effects: tuple[Candidate, Candidate],
    amplitudes: Floats,
    poses: tuple[Rows, Poses],
    arm: Arm,
    index: int | None,
) -> _Contest | None:
    adjustment, further = poses[0].adjustment, poses[1]
    wider = extended_rows(adjustment, further)
    blocks = _blocks(wider, arm, effects)
    if blocks is None:
        return None
    own = blocks[0] @ (amplitudes / np.array(effects[0].scales))
    unknowns = (wider if index is None else rows_without(wider, index)).columns
    return _Contest(
        own,
        np.hstack([unknowns, blocks[1]]),
        wider.poses,
        len(adjustment.network.campaign.poses),
        further,
    )


def _blocks(
    rows: Rows, arm: Arm, effects: tuple[Candidate, Candidate]
) -> list[Floats] | None:
    """Compute the columns of two effects in units of their scales."""
    banks: dict[BankName, Bank] = {}
    blocks = []
    for effect in effects:
        if effect.at_s is not None:
            blocks.append(step_columns(rows, effect.joint, effect.at_s))
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
            for one, part in zip(bank.candidates, bank.slices, strict=True)
            if one.identity == effect.identity
        ]
        if not places:
            return None
        blocks.append(bank.columns[:, places[0]])
    return blocks


def _chosen(contest: _Contest, gain: float, n_most: int) -> Experiment:
    measured = contest.poses < contest.n_measured
    _, values, turned = np.linalg.svd(contest.columns[measured], full_matrices=False)
    # Unknowns of unit variance: N is the unit matrix before anything is added.
    units = turned.T / np.sqrt(values**2 + _LEAST_EFFECT**2)
    contest = replace(contest, columns=contest.columns @ units)
    columns, own = contest.columns[measured], contest.own[measured]
    inverse = np.eye(columns.shape[1])
    best = columns.T @ own
    separations = [float(own @ (own - columns @ best))]
    waiting = _by_pose(contest)
    chosen: list[int] = []
    while len(chosen) < n_most and waiting and separations[-1] - separations[0] < gain:
        gains = [_gains(group, inverse, best) for group in waiting]
        at = int(np.argmax([np.max(one) for one in gains]))
        group = waiting[at]
        place = int(np.argmax(gains[at]))
        chosen.append(int(group.poses[place]))
        part, values = group.columns[place], group.own[place]
        across = inverse @ part.T
        weights = np.linalg.inv(np.eye(len(part)) + part @ across)
        misses = values - part @ best
        separations.append(separations[-1] + float(misses @ weights @ misses))
        best = best + across @ (weights @ misses)
        inverse = inverse - across @ weights @ across.T
        waiting[at] = group.without(place)
        waiting = [one for one in waiting if len(one.poses)]
    poses = contest.further.part(np.array(chosen, dtype=np.int64))
    enough = separations[-1] - separations[0] >= gain
    return Experiment(poses, np.maximum(np.array(separations), 0.0), enough)


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Further poses with as many equations each.

    Attributes:
        poses: Among the further ones, (n_poses,).
        columns: (n_poses, n_rows, n_columns).
        own: (n_poses, n_rows).
    """

    poses: Integers
    columns: Floats
    own: Floats

    def without(self, place: int) -> "_Group":
        """Take a pose out."""
        return _Group(
            np.delete(self.poses, place),
            np.delete(self.columns, place, axis=0),
            np.delete(self.own, place, axis=0),
        )


def _by_pose(contest: _Contest) -> list[_Group]:
    numbers = contest.poses - contest.n_measured
    rows = np.flatnonzero(numbers >= 0)
    rows = rows[np.argsort(numbers[rows], kind="stable")]
    poses, counts = np.unique(numbers[rows], return_counts=True)
    groups = []
    for count in np.unique(counts):
        mine = rows[np.repeat(counts == count, counts)]
        groups.append(
            _Group(
                poses[counts == count],
                contest.columns[mine].reshape(-1, count, contest.columns.shape[1]),
                contest.own[mine].reshape(-1, count),
            )
        )
    return groups


def _gains(group: _Group, inverse: Floats, best: Floats) -> Floats:
    """Compute by how much each pose raises Delta, (n_poses,)."""
    across = group.columns @ inverse
    covariances = across @ group.columns.swapaxes(1, 2)
    covariances = covariances + np.eye(covariances.shape[1])
    misses = (group.own - group.columns @ best)[:, :, np.newaxis]
    found: Floats = np.sum(misses * np.linalg.solve(covariances, misses), axis=(1, 2))
    return found
