"""Over what a term is drawn: the covariate that matters for its kind."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effect_table import EFFECT_KINDS, Family
from traverse.lab.campaign.campaign import Campaign, Poses
from traverse.lab.diagnosis.model.result import Term
from traverse.plurals import counted

# Waves that repeat more often are drawn one upon the other.
_MOST_PERIODS = 6


@dataclass(frozen=True, slots=True, eq=False)
class DrawnCovariate:
    """A quantity that poses are drawn over.

    Attributes:
        label: With its unit.
        values: (n_poses,); NaN where unknown.
        is_function: Whether the term is a function of it alone, so that a line can
            be drawn.
        signs: Of the covariate where shifts have none of their own, (n_poses,).
        one_direction: Whether shifts point the same way in all poses.
    """

    label: str
    values: Floats
    is_function: bool
    signs: Floats
    one_direction: bool = False


def covariate_of(
    term: Term, campaign: Campaign, amounts: Floats, reference_c: float
) -> DrawnCovariate:
    """Choose what a term is drawn over; the last resort is what it does to each pose.

    Thermal effects are zero at the reference temperature.
    """
    kind, joint = term.candidate.kind, term.candidate.joint
    poses = campaign.poses
    plain = np.ones(len(poses))
    row = EFFECT_KINDS[kind]
    name = next(iter(row.columns(joint)), None)
    if term.candidate.is_curve:
        name = term.candidate.covariate
    compliance = getattr(term.effect, "compliance_rad_nm", 0.0)
    if row.acts_on == "angle" and compliance != 0.0:
        # The joint turns further: as if it had read too little.
        label = f"gravity torque about {joint} [N m]"
        return DrawnCovariate(label, -amounts / compliance, True, plain)
    if name is None:
        size = float(np.nanmax(np.abs(amounts), initial=0.0))
        label = "what the effect does to the pose, of the largest"
        return DrawnCovariate(label, amounts / (size or 1.0), True, plain)
    label, values = column(campaign, name)
    if row.family is Family.WARM:
        away = np.nan_to_num(values - reference_c)
        return DrawnCovariate(label, values, joint is not None, away)
    periods = _periods(term)
    if periods > _MOST_PERIODS and name == f"{joint}_rad":
        label = (
            f"reading of {joint} within one of {counted(periods, 'period')} [degrees]"
        )
        values = np.mod(values, 360.0 / periods)
    one_direction = row.family is Family.SLOW and joint is None
    return DrawnCovariate(label, values, row.is_function, plain, one_direction)


def _periods(term: Term) -> float:
    """Count the periods of a term in a turn of its joint; 0: it has none."""
    if term.harmonic is not None:
        return term.harmonic
    is_wave = EFFECT_KINDS[term.candidate.kind].is_wave
    return (term.candidate.cycles or 0) if is_wave else 0


def column(campaign: Campaign, name: str) -> tuple[str, Floats]:
    """Find a column of the table of poses, angles in degrees: its label and values."""
    poses = campaign.poses
    for joint, own in enumerate(campaign.joint_names):
        if not name.startswith(own):
            continue
        rest = name.removeprefix(own)
        if rest == "_rad":
            angles_deg = np.degrees(poses.angles_rad[:, joint])
            return f"reading of {own} [degrees]", angles_deg
        found = _of_joint(poses, rest, joint)
        if found is not None:
            return _LABELS[rest].format(own), found
    of_arm = {
        "time_s": (time_label(campaign), poses.time_s),
        "temperature_c": ("temperature [°C]", poses.temperature_c),
        "force_n": ("contact force [N]", poses.force_n),
    }
    label, values = of_arm.get(name, (name, None))
    return label, np.full(len(poses), np.nan) if values is None else values


def time_label(campaign: Campaign) -> str:
    """Return what the times of a campaign are."""
    return "number of the pose" if campaign.time_is_order else "time [s]"


_LABELS = {
    "_temperature_c": "temperature of {} [°C]",
    "_speed_rad_s": "speed of {} [rad/s]",
    "_approach": "sense of the last motion of {}",
}


def _of_joint(poses: Poses, rest: str, joint: int) -> Floats | None:
    if rest == "_temperature_c":
        own = poses.joint_temperatures_c
        if own is None:
            return poses.temperature_c
        mine: Floats = own[:, joint]
        if poses.temperature_c is None:
            return mine
        return np.where(np.isnan(mine), poses.temperature_c, mine)
    table = {"_speed_rad_s": poses.speeds_rad_s, "_approach": poses.approaches}
    found = table.get(rest)
    return None if found is None else found[:, joint]
