"""Noise of a set of poses: the campaign as in its files, and the truth."""

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.arm.inverse import shifted_postures
from traverse.simulator.campaigns.artefacts.artefact import Table, drawn_rotation
from traverse.simulator.campaigns.artefacts.seats import DrawWire
from traverse.simulator.campaigns.campaign import (
    Campaign,
    SimulatedCampaign,
    StatedArtefact,
    Truth,
)
from traverse.simulator.campaigns.conditions import stream
from traverse.simulator.campaigns.noise import (
    contact_shifts,
    contact_stds,
    encoder_stds,
    oriented_poses,
    serial_noise,
    spoilt_poses,
)
from traverse.simulator.campaigns.pose_set import PoseSet
from traverse.simulator.campaigns.poses import make_poses
from traverse.simulator.campaigns.spec import CampaignSpec, NoiseTable
from traverse.simulator.effects.posture import tilt_matrices


def simulate_campaign(arm: Arm, spec: CampaignSpec, seed: int) -> SimulatedCampaign:
    return draw_noise(make_poses(arm, spec, seed), seed)


def draw_noise(
    poses: PoseSet, seed: int, noise: NoiseTable | None = None
) -> SimulatedCampaign:
    """Draw the errors of readings, contacts and certificates.

    The true lengths of standards are from the specification; the campaign states
    them with errors, so that the same poses serve for any number of draws.

    Equal seeds give equal errors; ``noise`` replaces the specification's.
    """
    noise = poses.spec.noise if noise is None else noise
    n_joints = poses.truth.mechanism.n_joints
    spoilt = spoilt_poses(poses, noise, stream(seed, "blunders"))
    touch = serial_noise(stream(seed, "touch"), poses.n_poses, 3, noise)
    shifts_mm = contact_shifts(poses.around.towards, touch)
    shifts_mm = contact_stds(noise, poses)[:, None] * shifts_mm
    shifts_mm = shifts_mm + spoilt.shifts_mm
    turns_rad = poses.turns_rad
    if np.any(shifts_mm):
        turns_rad = shifted_postures(poses.truth.mechanism, turns_rad, shifts_mm)
    errors_rad = serial_noise(stream(seed, "encoders"), poses.n_poses, n_joints, noise)
    errors_rad = errors_rad * encoder_stds(noise, n_joints) + spoilt.jumps_rad
    readings_rad = poses.faulty.readings_rad(turns_rad, poses.around) + errors_rad
    if noise.quantised:
        readings_rad = _whole_counts(readings_rad, poses.arm)
    around, columns = poses.around, poses.spec.conditions.columns
    encoder_rad, contact_mm = _stated_stds(noise, n_joints)
    mounting, orientation = _measured_orientations(
        poses, turns_rad, noise, spoilt.turns_rad, stream(seed, "orientations")
    )
    start_utc = poses.spec.conditions.start_utc
    campaign = Campaign(
        joints=tuple(joint.name for joint in poses.arm.joints),
        artefacts=_stated_artefacts(poses, seed),
        encoder_rad=encoder_rad,
        contact_mm=contact_mm,
        start_utc=None if start_utc is None else start_utc.isoformat(),
        time_s=around.time_s.copy(),
        artefact=spoilt.artefact,
        feature=spoilt.feature,
        readings_rad=readings_rad,
        temperature_c=around.temperature_c.copy() if "temperature" in columns else None,
        approach=around.approach.astype(np.int8) if "approach" in columns else None,
        speed_rad_s=around.speed_rad_s.copy() if "speed" in columns else None,
        direction=(
            _stated_directions(around.towards, noise, seed)
            if "direction" in columns
            else None
        ),
        force_n=around.force_n.copy() if "force" in columns else None,
        length_mm=_read_lengths(poses),
        orientation=orientation,
        orientation_rad=(
            noise.stated_factor * noise.orientation_rad
            if noise.stated and orientation is not None
            else None
        ),
    )
    truth = Truth(
        arm=poses.truth,
        artefacts=poses.artefacts,
        turns_rad=turns_rad.copy(),
        contacts_mm=poses.contacts_mm + shifts_mm,
        contact_noise_mm=shifts_mm,
        encoder_noise_rad=errors_rad,
        blunders=spoilt.blunders,
        effects=poses.effects,
        faults=poses.faults,
        mounting=mounting,
    )
    return SimulatedCampaign(campaign, truth)


def _read_lengths(poses: PoseSet) -> Floats | None:
    """Return the lengths that draw wires read, (n,), without contact noise.

    A contact displaced by its noise makes the length wrong.
    """
    lengths_mm = np.full(poses.n_poses, np.nan)
    for index, placed in enumerate(poses.artefacts):
        if isinstance(placed.artefact, DrawWire):
            of_artefact = poses.artefact_index == index
            away_mm = poses.contacts_mm[of_artefact] - placed.placement.position_mm
            drawn_mm = np.linalg.norm(away_mm, axis=1)
            lengths_mm[of_artefact] = drawn_mm - placed.artefact.offset_mm
    return None if np.all(np.isnan(lengths_mm)) else lengths_mm


def _measured_orientations(
    poses: PoseSet,
    turns_rad: Floats,
    noise: NoiseTable,
    off_rad: Floats,
    rng: np.random.Generator,
) -> tuple[Floats, Floats] | tuple[None, None]:
    """Return the probe's mounting (3, 3), and measured orientations (n, 4).

    The system of stated points has the axes of the instrument. Errors turn the
    probe about its own axes, beside others, (n, 3).
    """
    measured = oriented_poses(poses)
    if not np.any(measured):
        return None, None
    mounting = drawn_rotation(rng)
    errors = noise.orientation_rad * rng.standard_normal((poses.n_poses, 3))
    bodies = poses.faulty.last_body(turns_rad, poses.around) @ mounting
    frames = np.stack(
        [
            np.eye(3)
            if getattr(placed.artefact, "frame", "own") == "arm"
            else placed.placement.rotation
            for placed in poses.artefacts
        ]
    )
    seen = frames[poses.artefact_index].swapaxes(1, 2) @ bodies
    seen = seen @ tilt_matrices(np.zeros(3), errors + off_rad)[:, :3, :3]
    quaternions = np.array([_quaternion(rotation) for rotation in seen])
    quaternions[~measured] = np.nan
    return mounting, quaternions


def _quaternion(rotation: Floats) -> Floats:
    """Return a unit quaternion (4,) of a rotation (3, 3), of either sign.

    The eigenvector of the largest eigenvalue, 1, of a matrix of sums and differences of
    its entries (Bar-Itzhack).
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation
    sums = [
        [a + e + i, h - f, c - g, d - b],
        [h - f, a - e - i, b + d, c + g],
        [c - g, b + d, e - a - i, f + h],
        [d - b, c + g, f + h, i - a - e],
    ]
    mean: Floats = np.linalg.eigh(np.array(sums) / 3.0)[1][:, -1]
    return mean


def _whole_counts(readings_rad: Floats, arm: Arm) -> Floats:
    """Round readings (n, n_joints) to the encoders' counts."""
    per_turn = [joint.encoder.counts_per_turn for joint in arm.joints if joint.encoder]
    steps_rad = 2.0 * np.pi / np.array(per_turn, dtype=np.float64)
    rounded: Floats = np.rint(readings_rad / steps_rad) * steps_rad
    return rounded


def _stated_stds(noise: NoiseTable, n_joints: int) -> tuple[float | None, float | None]:
    """Return the stated noise; one number for all encoders."""
    if not noise.stated:
        return None, None
    mean_rad = noise.encoder_rad
    if noise.encoders_rad is not None:
        mean_rad = float(np.sqrt(np.mean(encoder_stds(noise, n_joints) ** 2)))
    return noise.stated_factor * mean_rad, noise.stated_factor * noise.contact_mm


def _stated_artefacts(poses: PoseSet, seed: int) -> tuple[StatedArtefact, ...]:
    rng = stream(seed, "certificates")
    stated = []
    for placed in poses.artefacts:
        artefact = placed.artefact
        table: Table = artefact.stated(rng, placed.placement)
        factor = 1.0 + poses.length_error(artefact.id)
        if factor != 1.0:
            table = _divided(table, factor)
        stated.append(StatedArtefact(artefact.id, artefact.kind, table))
    return tuple(stated)


def _divided(table: Table, factor: float) -> Table:
    """Return the statement of a standard that is longer than stated."""
    divided = dict(table)
    if "distance_mm" in table:
        divided["distance_mm"] = table["distance_mm"] / factor
    if "distances" in table:
        divided["distances"] = [
            _divided(distance, factor) for distance in table["distances"]
        ]
    if "points_mm" in table:
        divided["points_mm"] = {
            name: [component / factor for component in at_mm]
            for name, at_mm in table["points_mm"].items()
        }
    return divided


def _stated_directions(towards: Floats, noise: NoiseTable, seed: int) -> Floats:
    """Turn unit vectors (n, 3) a little; NaN where there are none."""
    errors = stream(seed, "directions").standard_normal(towards.shape)
    across = noise.direction_rad * np.cross(errors, towards)
    leaning = towards + across
    directions: Floats = leaning / np.linalg.norm(leaning, axis=1, keepdims=True)
    return directions
