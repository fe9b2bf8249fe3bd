"""From entries of `[[effects]]` to faults."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm, Effect
from traverse.simulator.effects import body_faults, reading_faults, touch_faults
from traverse.simulator.effects.fault import Fault
from traverse.simulator.effects.reading_faults import (
    OF_ARM,
    OF_JOINT,
    CurvedError,
    natural_slopes,
)
from traverse.strict_toml.problems import FileError, Problem

TIMED = {"encoder_drift", "count_slip", "base_drift", "base_step"}
WEIGHED = {"joint_compliance", "bearing_compliance", "mount_compliance"}
POINTING = {
    "axis_wobble": ("cos_rad", "sin_rad"),
    "axis_runout": ("cos_mm", "sin_mm"),
}
OF_STANDARDS = "artefact_length"


@dataclass(frozen=True, slots=True)
class EffectEntry:
    """An effect of an arm file with what it refers to.

    Attributes:
        values: Of the keys of its kind.
        joints: Which ones, from 0; all where it names none.
        joint: Which one; -1 where it names none.
        reference_c: Of the arm.
        epoch_utc_s: Since 1970; 0 where it has none.
        names: Of the arm's joints.
    """

    values: Mapping[str, Any]
    joints: slice
    joint: int
    reference_c: float
    epoch_utc_s: float
    names: tuple[str, ...]

    def __getitem__(self, key: str) -> Any:  # noqa: ANN401 - a number of some type
        return self.values[key]

    def array(self, key: str) -> Floats:
        """The vector of a key."""
        return np.array(self.values[key], dtype=np.float64)


def covariate_of(entry: EffectEntry) -> tuple[str, int] | None:
    """Column and joint (-1 for none) of an empirical effect."""
    name = str(entry.values["covariate"])
    if name in OF_ARM:
        return name, -1
    for number, joint in enumerate(entry.names):
        if name.startswith(joint) and name.removeprefix(joint) in OF_JOINT:
            return name.removeprefix(joint), number
    return None


def _curve(entry: EffectEntry) -> Fault:
    found = covariate_of(entry)
    if found is None:
        raise ValueError(f"'{entry.values['covariate']}' is no column of a campaign")
    knots, values_rad = entry.array("knots"), entry.array("values_rad")
    slopes = natural_slopes(knots, values_rad)
    return CurvedError(entry.joints, *found, knots, values_rad, slopes)


def _wave(entry: EffectEntry) -> Fault:
    v = entry.values
    order = v.get("order", 1)
    return reading_faults.WavyDisc(entry.joints, order, v["cos_rad"], v["sin_rad"])


MAKERS: Mapping[str, Callable[[EffectEntry], Fault]] = {
    "encoder_eccentricity": _wave,
    "encoder_harmonic": _wave,
    "transmission_error": lambda e: reading_faults.ToothedDrive(
        e.joints, e["cycles"], e["cos_rad"], e["sin_rad"]
    ),
    "encoder_scale": lambda e: reading_faults.LongTape(e.joints, e["scale_ppm"]),
    "encoder_temperature": lambda e: reading_faults.WarmHead(
        e.joints, e["rate_rad_c"], e.reference_c
    ),
    "encoder_drift": lambda e: reading_faults.CreepingZero(
        e.joints, e["rate_rad_s"], e.epoch_utc_s
    ),
    "count_slip": lambda e: reading_faults.LostCounts(
        e.joints, e["step_rad"], e["at_s"], e.epoch_utc_s
    ),
    "encoder_latency": lambda e: reading_faults.LateReading(e.joints, e["latency_s"]),
    "backlash": lambda e: reading_faults.Play(e.joints, e["half_width_rad"]),
    "empirical": _curve,
    "joint_compliance": lambda e: body_faults.SoftJoint(
        e.joint, e["compliance_rad_nm"]
    ),
    "bearing_compliance": lambda e: body_faults.SoftBearing(
        e.joint, e["compliance_rad_nm"]
    ),
    "mount_compliance": lambda e: body_faults.SoftMount(e["compliance_rad_nm"]),
    "thermal_expansion": lambda e: body_faults.WarmElements(
        e.joints, e["expansion_per_c"], e.reference_c
    ),
    "axis_wobble": lambda e: body_faults.WanderingAxis(
        e.joint, True, e["order"], e.array("cos_rad"), e.array("sin_rad")
    ),
    "axis_runout": lambda e: body_faults.WanderingAxis(
        e.joint, False, e["order"], e.array("cos_mm"), e.array("sin_mm")
    ),
    "base_drift": lambda e: body_faults.CreepingBase(
        e.array("rate_mm_s"), e.epoch_utc_s
    ),
    "base_step": lambda e: body_faults.KnockedBase(
        e.array("step_mm"), e["at_s"], e.epoch_utc_s
    ),
    "probe_radius": lambda e: touch_faults.LargerBall(e["radius_error_mm"]),
    "probe_lobing": lambda e: touch_faults.ThreeSeats(
        e["amplitude_mm"], e["phase_rad"]
    ),
    "stylus_bending": lambda e: touch_faults.SoftStylus(e["compliance_mm_n"]),
}


def faults_from_effects(
    arm: Arm, effects: Sequence[Effect], source: str = "arm file"
) -> tuple[Fault, ...]:
    """Make faults; those of standards are not the arm's and are left out.

    Messages call them ``source``.

    Raises:
        FileError: With all effects that cannot be played.
    """
    names = tuple(joint.name for joint in arm.joints)
    problems, faults = [], []
    for number, effect in enumerate(effects):
        if effect.kind == OF_STANDARDS:
            continue
        where = f"effects[{number}]"
        if effect.joint is not None and effect.joint not in names:
            message = f"'{effect.joint}' is no joint of this arm: {', '.join(names)}"
            problems.append(Problem(f"{where}.joint", message))
            continue
        joint = -1 if effect.joint is None else names.index(effect.joint)
        entry = EffectEntry(
            values=effect.values,
            joints=slice(None) if joint < 0 else slice(joint, joint + 1),
            joint=joint,
            reference_c=arm.reference.temperature_c,
            epoch_utc_s=effect.epoch_utc.timestamp() if effect.epoch_utc else 0.0,
            names=names,
        )
        if effect.kind in WEIGHED and not _has_weight(arm, max(joint, 0)):
            message = f"{effect.kind}: nothing beyond has a mass_kg; add what it weighs"
            problems.append(Problem(where, message))
        elif effect.kind == "empirical" and covariate_of(entry) is None:
            shown = effect.values["covariate"]
            message = (
                f"'{shown}' is no column of a campaign; expected {', '.join(OF_ARM)}, "
                f"or a joint followed by {', '.join(OF_JOINT)}"
            )
            problems.append(Problem(f"{where}.covariate", message))
        else:
            faults.append(MAKERS[effect.kind](entry))
    if problems:
        raise FileError(source, problems)
    return tuple(faults)


def effect_problems(arm: Arm, where: str) -> list[Problem]:
    """Report which effects of an arm file cannot be played, with their key paths."""
    try:
        faults_from_effects(arm, arm.effects)
    except FileError as error:
        return [Problem(f"{where} {p.where}", p.message) for p in error.problems]
    return []


def on_true_axes(
    arm: Arm, effects: Sequence[Effect], axes: Floats
) -> tuple[Effect, ...]:
    """Rotate vectors across or along design axes onto the true ones.

    A bearing wanders across the axis that it has, not across the one on paper.

    Axes are true unit vectors (n_joints, 3).
    """
    names = [joint.name for joint in arm.joints]
    turned: list[Effect] = []
    for effect in effects:
        if effect.kind not in POINTING or effect.joint is None:
            turned.append(effect)
            continue
        axis = axes[names.index(effect.joint)]
        values = {}
        for key in POINTING[effect.kind]:
            vector = np.array(effect.values[key], dtype=np.float64)
            along = float(vector @ axis) * axis
            is_axial = effect.values.get("component") == "axial"
            values[key] = tuple((along if is_axial else vector - along).tolist())
        turned.append(effect.model_copy(update=values))
    return tuple(turned)


def _has_weight(arm: Arm, joint: int) -> bool:
    masses = [*(beyond.mass_kg for beyond in arm.joints[joint:]), arm.probe.mass_kg]
    return any(mass is not None for mass in masses)
