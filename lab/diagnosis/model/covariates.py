"""Covariates of a campaign beside the touches, under the names of its columns."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.effects.base.block import Covariate, Need
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.statistics.outlier_clusters import Cluster, find_outlier_cluster

# Of the largest value: a spread below that is rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class CovariateColumn:
    """A covariate that varies.

    Attributes:
        name: As the arm file's curves call it.
        joint: Whose it is, counted from 0; None: of the whole arm.
        is_reading: Whether it is the joint's own angle.
        values: Of every pose of the campaign, (n_poses,).
    """

    name: str
    joint: int | None
    is_reading: bool
    values: Floats


def varies(rows: ObservationEquations, values: Floats) -> bool:
    """Return whether a covariate differs between the poses that take part.

    It has a value for every pose of the campaign, (n_poses,).
    """
    used = values[rows.used_poses]
    spread = float(np.ptp(used)) if len(used) else 0.0
    return spread > _ROUNDING * max(float(np.abs(used).max(initial=0.0)), 1e-3)


def covariate_values(rows: ObservationEquations, need: Need) -> Floats:
    """Return the covariate that an effect needs from a campaign, (n_poses,)."""
    block, joint = rows.block, slice(need.joint, (need.joint or 0) + 1)
    match need.covariate:
        case Covariate.TEMPERATURE if need.joint is not None:
            return np.asarray(block.temperatures_c(joint)[0])
        case Covariate.TEMPERATURE:
            return block.row("temperature_c")
        case Covariate.SPEED:
            return np.asarray(block.rows("speeds_rad_s", joint)[0])
        case Covariate.APPROACH:
            return np.asarray(block.rows("approaches", joint)[0])
        case Covariate.FORCE:
            return block.row("force_n")
        # The time in UTC differs from it by a constant.
        case Covariate.UTC | Covariate.CAMPAIGN_TIME:
            return block.row("campaign_s")


def outlier_cluster(
    rows: ObservationEquations,
    eligible: Booleans,
    included: Booleans,
    n_draws: int,
    seed: int,
) -> Cluster | None:
    """Find a cluster of poses that were left out, over all covariates.

    As many poses as were left out are drawn at random from the eligible ones, n_draws
    times.
    """
    poses = np.flatnonzero(eligible)
    campaign = rows.adjustment.network.campaign
    lines = [
        (
            column.name,
            None if column.joint is None else campaign.joint_names[column.joint],
            column.values[poses],
        )
        for column in covariate_columns(rows)
    ]
    return find_outlier_cluster(
        lines,
        campaign.poses.artefacts[poses],
        [artefact.id for artefact in campaign.artefacts],
        included[poses],
        n_draws=n_draws,
        seed=seed,
    )


def approach_columns(rows: ObservationEquations) -> list[CovariateColumn]:
    """List the senses of approach that are known and that vary."""
    names = rows.adjustment.network.campaign.joint_names
    needs = [Need(Covariate.APPROACH, joint) for joint in range(len(names))]
    columns = [
        CovariateColumn(
            f"{name}_approach", need.joint, False, covariate_values(rows, need)
        )
        for name, need in zip(names, needs, strict=True)
        if rows.block.lack(need) is None
    ]
    return [column for column in columns if varies(rows, column.values)]


def covariate_columns(rows: ObservationEquations) -> list[CovariateColumn]:
    """List the covariates that curves may depend on and that vary.

    Readings of all joints, time, temperature, force, and of each joint the speed and
    its own temperature.
    """
    block = rows.block
    names = rows.adjustment.network.campaign.joint_names
    readings = [
        CovariateColumn(f"{name}_rad", joint, True, block.angles_rad[:, joint])
        for joint, name in enumerate(names)
    ]
    of_campaign = {
        "time_s": Covariate.CAMPAIGN_TIME,
        "temperature_c": Covariate.TEMPERATURE,
        "force_n": Covariate.FORCE,
    }
    of_joints = {"temperature_c": Covariate.TEMPERATURE, "speed_rad_s": Covariate.SPEED}
    if block.joint_temperatures_c is None:
        del of_joints["temperature_c"]
    needed = [
        *((name, Need(of)) for name, of in of_campaign.items()),
        *(
            (f"{name}_{suffix}", Need(of, joint))
            for suffix, of in of_joints.items()
            for joint, name in enumerate(names)
        ),
    ]
    further = [
        CovariateColumn(name, need.joint, False, covariate_values(rows, need))
        for name, need in needed
        if block.lack(need) is None
    ]
    return [
        covariate for covariate in readings + further if varies(rows, covariate.values)
    ]
