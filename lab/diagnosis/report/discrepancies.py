"""Simulation against measurement, pose by pose: where the discrepancy lives.

The simulation is the model of the arm. A pose's misclosure w is where the model puts
the ball, less where the artefact is. Whitened by its noise, L^-1 w = v, it also says
what a single cause would have to be: moved by e = L^-1 B d for each unit of a cause,

    amount = - e . v / e . e        standard deviation 1 / |e|

explains a pose best, be the cause a shift of the ball along a direction or a joint's
reading that is too large (then: measured reading less the simulated one).
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.lab.adjustment import Adjustment, Noise
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.poses import texts


@dataclass(frozen=True, slots=True, eq=False)
class Discrepancies:
    """Measurement against one model, an entry a pose of the campaign.

    Attributes:
        misclosures_mm: (n_poses, 3); NaN where there is none: surfaces have only the
            first.
        whitened: In standard deviations of noise, zero where there is none,
            (n_poses, 3).
        by_centre: How that changes with the model's ball centre [1/mm],
            (n_poses, 3, 3).
        by_readings: How it changes with readings [1/rad], (n_poses, 3, n_joints).
        took_part: In the fit, (n_poses,).
    """

    campaign: Campaign
    misclosures_mm: Floats
    whitened: Floats
    by_centre: Floats
    by_readings: Floats
    took_part: Booleans

    @property
    def sizes(self) -> Floats:
        """Root mean square of a pose's misclosures in sigma, (n_poses,)."""
        n_rows = np.count_nonzero(np.isfinite(self.misclosures_mm), axis=1)
        total = np.sum(self.whitened**2, axis=1)
        sizes: Floats = np.sqrt(total / np.maximum(n_rows, 1))
        return sizes

    def along(self, directions: Floats) -> tuple[Floats, Floats]:
        """Compute the ball's error along directions, (n_poses, 3), for each pose alone.

        The amount, measured less simulated, and its standard deviation, NaN where it is
        undetermined, both (n_poses,).
        """
        return self._amount(np.einsum("nij,nj->ni", self.by_centre, directions))

    def reading_errors_rad(self, joint: int) -> tuple[Floats, Floats]:
        """Return by how much a reading is larger than the simulation's, (n_poses,).

        For each pose alone, if this joint were the only cause; with its
        standard deviation.
        """
        return self._amount(-self.by_readings[:, :, joint])

    def as_reading_rad(self, joint: int, moves_mm: Floats) -> Floats:
        """Say which error of a reading does the same as moves of the ball, (n, 3)."""
        moved = np.einsum("nij,nj->ni", self.by_centre, moves_mm)
        by_reading = -self.by_readings[:, :, joint]
        squares = np.sum(by_reading**2, axis=1)
        safe = np.where(squares > 0.0, squares, np.nan)
        errors_rad: Floats = np.sum(by_reading * moved, axis=1) / safe
        return errors_rad

    def _amount(self, effects: Floats) -> tuple[Floats, Floats]:
        squares = np.sum(effects**2, axis=1)
        safe = np.where(squares > 0.0, squares, np.nan)
        along = np.sum(effects * self.whitened, axis=1)
        return -along / safe, 1.0 / np.sqrt(safe)


def discrepancies(adjustment: Adjustment, noise: Noise | None = None) -> Discrepancies:
    """Compare all poses of a campaign with a fitted model.

    Poses that took no part are compared at the same artefacts; an artefact that was
    held out whole is put where its own poses say.

    In units of the noise; default that of the fit.
    """
    network = adjustment.network
    campaign = network.campaign
    n_poses, n_joints = len(campaign.poses), network.parameters.n_joints
    network = replace(
        network, noise=noise or network.noise, weights=np.ones(n_poses, dtype=float)
    )
    compared = Discrepancies(
        campaign,
        np.full((n_poses, 3), np.nan),
        np.zeros((n_poses, 3)),
        np.zeros((n_poses, 3, 3)),
        np.zeros((n_poses, 3, n_joints)),
        network.included,
    )
    arm = adjustment.state.arm
    for station in network.stations_of(np.ones(n_poses, dtype=np.bool_)):
        unknowns = adjustment.unknowns_of(station)
        for rows in network.white_rows(station, arm, unknowns):
            poses = station.poses[rows.part]
            n_rows = rows.misclosures_mm.shape[1]  # orientations are left out
            compared.misclosures_mm[poses, :n_rows] = rows.misclosures_mm
            compared.whitened[poses, :n_rows] = rows.misclosures[:, :n_rows]
            compared.by_centre[poses, :n_rows] = rows.by_centre[:, :n_rows]
            by_readings = rows.by_readings[:, :n_rows] / network.noise.encoder_rad
            compared.by_readings[poses, :n_rows] = by_readings
    return compared


def write_discrepancies(
    path: Path, before: Discrepancies, after: Discrepancies, parts: tuple[str, ...]
) -> None:
    """Write both comparisons as CSV, a line a pose.

    The parts say what became of each pose, (n_poses,).
    """
    campaign = before.campaign
    poses = campaign.poses
    columns = {"time_s": poses.time_s}
    if poses.temperature_c is not None:
        columns["temperature_c"] = poses.temperature_c
    for when, compared in (("before", before), ("after", after)):
        for row, misclosures_mm in enumerate(compared.misclosures_mm.T, start=1):
            columns[f"{when}_{row}_mm"] = misclosures_mm
        columns[f"{when}_sigma"] = compared.sizes
        for joint, name in enumerate(campaign.joint_names):
            columns[f"{when}_{name}_rad"] = compared.reading_errors_rad(joint)[0]
    values = np.column_stack(list(columns.values()))
    header = ["part", *columns]
    campaign.write_table(path, header, lambda at: [parts[at], *texts(values[at])])
