"""A dense scan: successive drags as a stream of encoder counts."""

from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Floats, Integers
from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.arm.inverse import shifted_postures
from traverse.simulator.arm.truth import TrueArm, true_arm
from traverse.simulator.campaigns.artefacts import Cone, Sphere
from traverse.simulator.campaigns.campaign import StatedArtefact
from traverse.simulator.campaigns.conditions import stream, temperatures_c
from traverse.simulator.campaigns.dense.motion import (
    Drag,
    Dragging,
    moved_between,
)
from traverse.simulator.campaigns.dense.spec import DenseFile, dense_misfits
from traverse.simulator.campaigns.noise import (
    contact_shifts,
    encoder_stds,
    serial_noise,
)
from traverse.simulator.campaigns.postures import workspace_of
from traverse.simulator.campaigns.siting import place_artefacts, refuse_misfits
from traverse.simulator.effects import (
    FaultyArm,
    Surroundings,
    faults_from_effects,
    on_true_axes,
)
from traverse.simulator.effects.faulty_arm import faulty_arm

START = datetime(2026, 11, 20, 9, tzinfo=UTC)
CHUNK = 20_000
NOTHING = -1


@dataclass(frozen=True, slots=True)
class DenseScan:
    """A stream and its truth.

    Attributes:
        artefacts: as the campaign states them.
        counts: (n, n_joints) raw.
        touched: (n,) index of the artefact, -1 for none.
        readings_rad: (n, n_joints) before they became counts.
    """

    arm: Arm
    artefacts: tuple[StatedArtefact, ...]
    file: DenseFile
    start_utc: datetime
    around: Surroundings
    counts: NDArray[np.uint32]
    touched: Integers
    truth: TrueArm
    readings_rad: Floats


def simulate_scan(arm: Arm, file: DenseFile, seed: int) -> DenseScan:
    """Draw a whole scan from one seed.

    Raises:
        FileError: something does not fit arm or scan, or an effect cannot be played.
        UnreachableError: something cannot be reached or followed.
    """
    refuse_misfits(file, arm, *dense_misfits(file, arm))
    truth = true_arm(arm, file.deviations, seed)
    workspace = workspace_of(truth.mechanism, file.travel, file.limits_rad)
    placements = place_artefacts(
        file.artefacts, workspace, truth.radius_mm, stream(seed, "placement")
    )
    rng = stream(seed, "contacts")
    dragging = Dragging(workspace, truth.radius_mm, file.scan, rng)
    order = _order([artefact.n_poses for artefact in file.artefacts])
    drags = [
        dragging.drag(artefact, placements[index])
        for index in order
        if isinstance(artefact := file.artefacts[index], Cone | Sphere)
    ]
    turns_rad, drag_of = _joined(drags, file)
    touched = np.append(order, NOTHING)[drag_of]
    faulty = _faulty(arm, truth)
    speeds_rad_s = np.gradient(turns_rad, axis=0) * file.scan.rate_hz
    speeds_rad_s = faulty.build.encoders_of(speeds_rad_s)
    around = _surroundings(file, drags, drag_of, speeds_rad_s, seed)
    readings_rad = _readings(
        file, faulty, drags, (turns_rad, drag_of), around, seed=seed
    )
    certificates = stream(seed, "certificates")
    return DenseScan(
        arm=arm,
        artefacts=tuple(
            StatedArtefact(
                placed.id, placed.kind, placed.stated(certificates, placement)
            )
            for placed, placement in zip(file.artefacts, placements, strict=True)
        ),
        file=file,
        start_utc=file.conditions.start_utc or START,
        around=around,
        counts=_counts(readings_rad, arm),
        touched=touched,
        truth=truth,
        readings_rad=readings_rad,
    )


def _order(counts: list[int]) -> list[int]:
    """Return the order of drags over artefacts: round after round."""
    return [
        index
        for round_ in range(max(counts))
        for index, count in enumerate(counts)
        if round_ < count
    ]


def _joined(drags: list[Drag], file: DenseFile) -> tuple[Floats, Integers]:
    """All turns (n, n_joints) in the order of time, and whose drag (n,) each is."""
    n_moving = max(round(file.scan.move_seconds * file.scan.rate_hz), 2)
    parts, numbers = [drags[0].turns_rad], [np.zeros(len(drags[0].turns_rad), int)]
    for number, drag in enumerate(drags[1:], 1):
        way = moved_between(parts[-1][-1], drag.turns_rad[0], n_moving)
        parts += [way, drag.turns_rad]
        numbers += [np.full(n_moving, NOTHING), np.full(len(drag.turns_rad), number)]
    return np.concatenate(parts), np.concatenate(numbers).astype(np.int64)


def _surroundings(
    file: DenseFile,
    drags: list[Drag],
    drag_of: Integers,
    speed_rad_s: Floats,
    seed: int,
) -> Surroundings:
    table, rate_hz = file.conditions, file.scan.rate_hz
    rng = stream(seed, "conditions")
    time_s = np.arange(len(speed_rad_s)) / rate_hz
    temperature_c = temperatures_c(table, time_s / time_s[-1], rng)
    forces = np.exp(table.force_spread * rng.standard_normal(len(drags) + 1))
    towards = np.full((len(speed_rad_s), 3), np.nan)
    towards[drag_of != NOTHING] = np.concatenate([drag.towards for drag in drags])
    return Surroundings(
        time_s=time_s,
        utc_s=(table.start_utc or START).timestamp() + time_s,
        temperature_c=temperature_c,
        speed_rad_s=speed_rad_s,
        approach=_senses(speed_rad_s),
        towards=towards,
        force_n=table.force_n * forces[drag_of],
    )


def _senses(speed_rad_s: Floats) -> Floats:
    """Return signs of the last motion (n, n_joints); before any, of the first."""
    moving = speed_rad_s != 0.0
    rows = np.where(moving, np.arange(len(speed_rad_s))[:, None], 0)
    last = np.maximum.accumulate(rows, axis=0)
    senses: Floats = np.sign(np.take_along_axis(speed_rad_s, last, axis=0))
    return senses


def _faulty(arm: Arm, truth: TrueArm) -> FaultyArm:
    effects = on_true_axes(arm, arm.effects, truth.mechanism.axes)
    faults = faults_from_effects(arm, effects, "effects of a simulated scan")
    return faulty_arm(arm, truth.mechanism, truth.zeros_rad, faults)


def _readings(
    file: DenseFile,
    faulty: FaultyArm,
    drags: list[Drag],
    motion: tuple[Floats, Integers],
    around: Surroundings,
    *,
    seed: int,
) -> Floats:
    """Return readings (n, n_joints), with noise."""
    turns_rad, drag_of = motion
    n_samples, n_joints = turns_rad.shape
    touching = drag_of != NOTHING
    contacts_mm = np.zeros((n_samples, 3))
    contacts_mm[touching] = np.concatenate([drag.contacts_mm for drag in drags])
    shaken = serial_noise(stream(seed, "touch"), n_samples, 3, file.noise)
    shifts_mm = file.noise.contact_mm * contact_shifts(around.towards, shaken)
    errors = serial_noise(stream(seed, "encoders"), n_samples, n_joints, file.noise)
    errors *= encoder_stds(file.noise, n_joints)
    readings_rad = np.empty_like(turns_rad)
    for first in range(0, n_samples, CHUNK):
        rows = slice(first, first + CHUNK)
        part = around.part(rows)
        moved = turns_rad[rows].copy()
        touched_rows = np.flatnonzero(touching[rows])
        if len(touched_rows):
            # Moved first, so that effects are those of where the ball really is.
            yielding = faulty.touching_turns(
                moved[touched_rows],
                contacts_mm[rows][touched_rows],
                part.part(touched_rows),
            )
            moved[touched_rows] = shifted_postures(
                faulty.build.mechanism, yielding, shifts_mm[rows][touched_rows]
            )
        readings_rad[rows] = faulty.readings_rad(moved, part) + errors[rows]
    return readings_rad


def _counts(readings_rad: Floats, arm: Arm) -> NDArray[np.uint32]:
    encoders = [joint.encoder for joint in arm.joints if joint.encoder is not None]
    per_turn = np.array([encoder.counts_per_turn for encoder in encoders])
    signs = np.array([encoder.sign for encoder in encoders])
    turned_counts = np.rint(signs * readings_rad * per_turn / (2.0 * np.pi)).astype(
        np.int64
    )
    counts: NDArray[np.uint32] = (turned_counts % per_turn).astype(np.uint32)
    return counts
