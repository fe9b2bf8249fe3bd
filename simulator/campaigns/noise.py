"""Errors of readings and contacts, white or serially correlated, and blunders."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Floats, Indices
from traverse.simulator.arm.physics import centre_rates
from traverse.simulator.campaigns.artefacts import Points
from traverse.simulator.campaigns.campaign import Blunder, Names
from traverse.simulator.campaigns.pose_set import PoseSet
from traverse.simulator.campaigns.spec import BlunderKind, NoiseTable

LEAST_LEVER = 0.3  # of the longest: a joint that jumps must be felt at the contact


@dataclass(frozen=True, slots=True)
class PosesWithOutliers:
    """Poses with blunders.

    Attributes:
        blunders: in the order of rows.
        shifts_mm: (n, 3) of the contact.
        jumps_rad: (n, n_joints) of the readings.
        turns_rad: (n, 3) of the measured orientations.
        artefact: (n,) ids as written.
        feature: (n,) names as written.
    """

    blunders: tuple[Blunder, ...]
    shifts_mm: Floats
    jumps_rad: Floats
    turns_rad: Floats
    artefact: Names
    feature: Names


def spoilt_poses(
    poses: PoseSet, noise: NoiseTable, rng: np.random.Generator
) -> PosesWithOutliers:
    """Draw blunders, in a share of the poses.

    The size is in standard deviations of the misclosure along the normal, in a seat
    along the disturbed direction: sqrt(contact^2 + |d' J stds|^2), with J the
    derivative of the ball's centre by the readings.
    """
    artefact, feature = _labels(poses)
    n_joints = poses.truth.mechanism.n_joints
    shifts_mm = np.zeros((poses.n_poses, 3))
    jumps_rad = np.zeros((poses.n_poses, n_joints))
    off_rad = np.zeros((poses.n_poses, 3))
    confusable, oriented = _confusable(poses), oriented_poses(poses)
    rows = rng.permutation(_spoilable(poses, noise, confusable))
    rows = rows[: round(noise.blunder_share * poses.n_poses)]
    blunders = []
    for row in np.sort(rows).tolist():
        kinds = [
            kind
            for kind in noise.blunder_kinds
            if (kind != "label" or confusable[poses.artefact_index[row]])
            and (kind != "orientation" or oriented[row])
        ]
        kind: BlunderKind = kinds[int(rng.integers(len(kinds)))]
        if kind == "label":
            was = f"{artefact[row]}/{feature[row]}"
            artefact[row], feature[row] = _mistaken(poses, row, confusable, rng)
            blunders.append(Blunder(row, kind, np.nan, "", was))
            continue
        if kind == "orientation":
            turn = rng.standard_normal(3)
            size_rad = noise.blunder_sigma * noise.orientation_rad
            off_rad[row] = size_rad * turn / np.linalg.norm(turn)
            blunders.append(Blunder(row, kind, size_rad, "rad", ""))
            continue
        disturbance = _Disturbance(poses, noise, row)
        if kind == "contact":
            shifts_mm[row] = disturbance.shift_mm(rng)
            size_mm = float(np.linalg.norm(shifts_mm[row]))
            blunders.append(Blunder(row, kind, size_mm, "mm", ""))
        else:
            joint, jump_rad = disturbance.jump(rng)
            jumps_rad[row, joint] = jump_rad
            name = poses.arm.joints[joint].name
            blunders.append(Blunder(row, kind, jump_rad, "rad", name))
    return PosesWithOutliers(
        tuple(blunders), shifts_mm, jumps_rad, off_rad, artefact, feature
    )


def oriented_poses(poses: PoseSet) -> NDArray[np.bool_]:
    """Return which orientations are measured, (n,)."""
    measured = [
        isinstance(placed.artefact, Points) and placed.artefact.orientations
        for placed in poses.artefacts
    ]
    return np.array(measured)[poses.artefact_index]


def _labels(poses: PoseSet) -> tuple[Names, Names]:
    """Return right ids (n,) and feature names (n,)."""
    ids = np.array([placed.artefact.id for placed in poses.artefacts])
    longest = max(
        len(name) for placed in poses.artefacts for name in placed.artefact.features
    )
    feature = np.empty(poses.n_poses, dtype=f"<U{max(longest, 1)}")
    for number, placed in enumerate(poses.artefacts):
        rows = poses.artefact_index == number
        names = np.array(placed.artefact.features)
        feature[rows] = names[poses.feature_index[rows]]
    return ids[poses.artefact_index], feature


def _confusable(poses: PoseSet) -> list[list[tuple[int, int]]]:
    """Return by artefact the (artefact, feature) that may be mistaken for it.

    Another feature of the same artefact or, if it has only one, another artefact of the
    same kind.
    """
    kinds = [placed.artefact.kind for placed in poses.artefacts]
    labels_of = []
    for number, placed in enumerate(poses.artefacts):
        n_features = len(placed.artefact.features)
        if n_features > 1:
            labels_of.append([(number, feature) for feature in range(n_features)])
        else:
            alike = np.flatnonzero(np.array(kinds) == kinds[number]).tolist()
            labels_of.append([(twin, 0) for twin in alike if twin != number])
    return labels_of


def _spoilable(
    poses: PoseSet, noise: NoiseTable, confusable_with: list[list[tuple[int, int]]]
) -> Indices:
    """Return rows in which a kind of blunder is possible."""
    confusable = np.array([bool(labels) for labels in confusable_with])
    is_spoilable = {
        "label": confusable[poses.artefact_index],
        "orientation": oriented_poses(poses),
    }
    everyone = np.ones(poses.n_poses, dtype=np.bool_)
    befallen = [is_spoilable.get(kind, everyone) for kind in noise.blunder_kinds]
    return np.flatnonzero(np.any(befallen, axis=0))


def _mistaken(
    poses: PoseSet,
    row: int,
    confusable: list[list[tuple[int, int]]],
    rng: np.random.Generator,
) -> tuple[str, str]:
    """Draw a wrong id and feature name for a row."""
    right = (int(poses.artefact_index[row]), int(poses.feature_index[row]))
    wrong = [labels for labels in confusable[right[0]] if labels != right]
    number, feature = wrong[int(rng.integers(len(wrong)))]
    artefact = poses.artefacts[number].artefact
    return artefact.id, artefact.features[feature]


class _Disturbance:
    """Change that disturbs a row by a number of standard deviations."""

    def __init__(self, poses: PoseSet, noise: NoiseTable, row: int) -> None:
        mechanism = poses.truth.mechanism
        rows: Indices = np.array([row])
        self._levers_mm = centre_rates(mechanism, poses.turns_rad[rows])[1][0]
        self._towards = poses.around.towards[row]
        self._contact_mm = float(contact_stds(noise, poses)[row])
        self._stds_rad = encoder_stds(noise, mechanism.n_joints)
        self._sigma = noise.blunder_sigma

    def shift_mm(self, rng: np.random.Generator) -> Floats:
        """Draw a displacement (3,) along the normal, or in a seat in any direction."""
        direction = rng.standard_normal(3)
        if not np.isnan(self._towards[0]):
            direction = np.sign(direction[0]) * self._towards
        direction = direction / np.linalg.norm(direction)
        shift: Floats = self._sigma * self._std_mm(direction) * direction
        return shift

    def jump(self, rng: np.random.Generator) -> tuple[int, float]:
        seated = np.isnan(self._towards[0])
        levers_mm = (
            np.linalg.norm(self._levers_mm, axis=0)
            if seated
            else np.abs(self._towards @ self._levers_mm)
        )
        felt = np.flatnonzero(levers_mm >= LEAST_LEVER * np.max(levers_mm))
        # A jump that moves the ball mostly along a curved surface would have to be so
        # large that it is not the misclosure it was meant to be.
        straight = levers_mm[felt] / np.linalg.norm(self._levers_mm[:, felt], axis=0)
        felt = felt[straight >= min(LEAST_LEVER, float(np.max(straight)))]
        joint = int(felt[rng.integers(len(felt))])
        direction = (
            self._levers_mm[:, joint] / levers_mm[joint] if seated else self._towards
        )
        size_rad = self._sigma * self._std_mm(direction) / float(levers_mm[joint])
        return joint, size_rad * float(rng.choice((-1.0, 1.0)))

    def _std_mm(self, direction: Floats) -> float:
        """Return the standard deviation of the misclosure along a direction (3,)."""
        by_joint_mm = (direction @ self._levers_mm) * self._stds_rad
        return float(np.hypot(self._contact_mm, np.linalg.norm(by_joint_mm)))


def encoder_stds(noise: NoiseTable, n_joints: int) -> Floats:
    """Return standard deviations (n_joints,) [rad]."""
    if noise.encoders_rad is None:
        return np.full(n_joints, noise.encoder_rad)
    return np.array(noise.encoders_rad, dtype=np.float64)


def contact_stds(noise: NoiseTable, poses: PoseSet) -> Floats:
    """Return standard deviations (n,) [mm]; an artefact may have its own."""
    contact_stds_mm = [placed.artefact.contact_mm for placed in poses.artefacts]
    stds_mm = np.array(
        [noise.contact_mm if std is None else std for std in contact_stds_mm]
    )
    return stds_mm[poses.artefact_index]


def serial_noise(
    rng: np.random.Generator, n_rows: int, n_columns: int, noise: NoiseTable
) -> Floats:
    """Draw standard normal numbers (n_rows, n_columns), partly correlated along rows.

    sqrt(1 - share) white + sqrt(share) e with e_i = phi e_(i-1) + sqrt(1 - phi^2) w_i.
    """
    white = rng.standard_normal((n_rows, n_columns))
    share, phi = noise.serial_share, noise.serial_phi
    if share == 0.0:
        return white
    drifting = rng.standard_normal((n_rows, n_columns))
    fresh = np.sqrt(1.0 - phi**2)
    for row in range(1, n_rows):
        drifting[row] = phi * drifting[row - 1] + fresh * drifting[row]
    mixed: Floats = np.sqrt(1.0 - share) * white + np.sqrt(share) * drifting
    return mixed


def contact_shifts(towards: Floats, standard: Floats) -> Floats:
    """Return displacements (n, 3): along the normal, in a seat in all directions.

    Of (n, 3) standard normal numbers the first serves along the normal.
    """
    along = standard[:, :1] * np.nan_to_num(towards)
    return np.where(np.isnan(towards[:, :1]), standard, along)
