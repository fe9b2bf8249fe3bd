"""What every run begins with: arm and campaign, and how an adjustment fails."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np

from traverse.kinematics.arm_file.arm import Arm, read_arm
from traverse.lab.campaign.campaign import Campaign, read_campaign
from traverse.lab.campaign.prior import read_prior
from traverse.lab.report.provenance import ReportProvenance


class BreakdownError(ArithmeticError):
    """The mathematics of an adjustment broke down."""


def read_inputs(
    folder: Path, arm_file: Path, family: Path | None = None, prior: Sequence[str] = ()
) -> tuple[Arm, Campaign]:
    """Read an arm and a campaign, with what its family says of parameters by pattern.

    Raises:
        FileError: A file is wrong, or the family is of another design.
    """
    arm = read_arm(arm_file)
    names = [joint.name for joint in arm.joints]
    campaign = read_campaign(folder, names, several_tools=True, orientations=True)
    if family is not None:
        campaign = replace(campaign, prior=read_prior(family, arm, prior))
    return arm, campaign


def broken_down(campaign: Campaign, error: np.linalg.LinAlgError) -> str:
    """Say what broke down, and what to check."""
    return (
        f"{campaign.name}: the adjustment broke down ({error}); check units, signs and "
        "zeros of the arm file, and the features of the poses"
    )


def date_of(provenance: ReportProvenance) -> datetime:
    return datetime.fromisoformat(provenance.date_utc)
