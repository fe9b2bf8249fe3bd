"""From entries of `[[effects]]` to faults."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinematics.arm_file import Arm, Effect, FileError, Problem
from simulator.effects import body_faults, encoder_faults, touch_faults
from simulator.effects.empirical_fault import (
    OF_ARM,
    OF_JOINT,
    CurvedError,
    natural_slopes,
)
from simulator.effects.fault import Fault
from simulator.physics import Floats

TIMED = {"encoder_drift", "count_slip", "base_drift", "base_step"}
WEIGHED = {"joint_compliance", "bearing_compliance", "mount_compliance"}
POINTING = {
    "axis_wobble": ("cos_rad", "sin_rad"),
    "axis_runout": ("cos_mm", "sin_mm"),
}
OF_STANDARDS = "artefact_length"


@dataclass(frozen=True, slots=True)
class _Entry:
    """An effect of an arm file with what it refers to."""

    values: Mapping[str, Any]
    joints: slice
    joint: int
    reference_c: float
    epoch_utc_s: float
    names: tuple[str, ...]


def faults_from_effects(
    arm: Arm, effects: Sequence[Effect], source: str = "arm file"
) -> tuple[Fault, ...]:
    """Make faults; those of standards are not the arm's and are left out.

    Args:
        arm: With the joints that effects name and their masses.
        effects: In any order.
        source: What to call them in messages.

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
        entry = _Entry(
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
        elif effect.kind == "empirical" and _covariate(entry) is None:
            shown = effect.values["covariate"]
            message = (
                f"'{shown}' is no column of a campaign; expected {', '.join(OF_ARM)}, "
                f"or a joint followed by {', '.join(OF_JOINT)}"
            )
            problems.append(Problem(f"{where}.covariate", message))
        else:
            faults.append(_MAKERS[effect.kind](entry))
    if problems:
        raise FileError(source, problems)
    return tuple(faults)


def on_true_axes(
    arm: Arm, effects: Sequence[Effect], axes: Floats
) -> tuple[Effect, ...]:
    """Turn vectors that lie across or along design axes onto the true ones.

    A bearing wanders across the axis that it has, not across the one on paper.

    Args:
        arm: With the design axes.
        effects: Whose vectors suit them.
        axes: (n_joints, 3) true unit vectors.
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


def _covariate(entry: _Entry) -> tuple[str, int] | None:
    """Column and joint (-1 for none) of an empirical effect."""
    name = str(entry.values["covariate"])
    if name in OF_ARM:
        return name, -1
    for number, joint in enumerate(entry.names):
        if name.startswith(joint) and name.removeprefix(joint) in OF_JOINT:
            return name.removeprefix(joint), number
    return None


def _wave(entry: _Entry) -> Fault:
    v = entry.values
    return encoder_faults.WavyDisc(
        entry.joints, v.get("order", 1), v["cos_rad"], v["sin_rad"]
    )


def _scale(entry: _Entry) -> Fault:
    return encoder_faults.LongTape(entry.joints, entry.values["scale_ppm"])


def _warm_head(entry: _Entry) -> Fault:
    rate = entry.values["rate_rad_c"]
    return encoder_faults.WarmHead(entry.joints, rate, entry.reference_c)


def _zero(entry: _Entry) -> Fault:
    rate = entry.values["rate_rad_s"]
    return encoder_faults.CreepingZero(entry.joints, rate, entry.epoch_utc_s)


def _slip(entry: _Entry) -> Fault:
    v = entry.values
    return encoder_faults.LostCounts(
        entry.joints, v["step_rad"], v["at_s"], entry.epoch_utc_s
    )


def _late(entry: _Entry) -> Fault:
    return encoder_faults.LateReading(entry.joints, entry.values["latency_s"])


def _play(entry: _Entry) -> Fault:
    return encoder_faults.Play(entry.joints, entry.values["half_width_rad"])


def _curve(entry: _Entry) -> Fault:
    found = _covariate(entry)
    if found is None:
        raise ValueError(f"'{entry.values['covariate']}' is no column of a campaign")
    knots = np.array(entry.values["knots"], dtype=np.float64)
    values_rad = np.array(entry.values["values_rad"], dtype=np.float64)
    slopes = natural_slopes(knots, values_rad)
    return CurvedError(entry.joints, *found, knots, values_rad, slopes)


def _joint(entry: _Entry) -> Fault:
    return body_faults.SoftJoint(entry.joint, entry.values["compliance_rad_nm"])


def _bearing(entry: _Entry) -> Fault:
    return body_faults.SoftBearing(entry.joint, entry.values["compliance_rad_nm"])


def _mount(entry: _Entry) -> Fault:
    return body_faults.SoftMount(entry.values["compliance_rad_nm"])


def _elements(entry: _Entry) -> Fault:
    rate = entry.values["expansion_per_c"]
    return body_faults.WarmElements(entry.joints, rate, entry.reference_c)


def _wobble(entry: _Entry) -> Fault:
    v = entry.values
    cos, sin = np.array(v["cos_rad"]), np.array(v["sin_rad"])
    return body_faults.WanderingAxis(entry.joint, True, v["order"], cos, sin)


def _runout(entry: _Entry) -> Fault:
    v = entry.values
    cos, sin = np.array(v["cos_mm"]), np.array(v["sin_mm"])
    return body_faults.WanderingAxis(entry.joint, False, v["order"], cos, sin)


def _base(entry: _Entry) -> Fault:
    rate = np.array(entry.values["rate_mm_s"])
    return body_faults.CreepingBase(rate, entry.epoch_utc_s)


def _knock(entry: _Entry) -> Fault:
    v = entry.values
    return body_faults.KnockedBase(np.array(v["step_mm"]), v["at_s"], entry.epoch_utc_s)


def _ball(entry: _Entry) -> Fault:
    return touch_faults.LargerBall(entry.values["radius_error_mm"])


def _seats(entry: _Entry) -> Fault:
    return touch_faults.ThreeSeats(
        entry.values["amplitude_mm"], entry.values["phase_rad"]
    )


def _stylus(entry: _Entry) -> Fault:
    return touch_faults.SoftStylus(entry.values["compliance_mm_n"])


_MAKERS: Mapping[str, Callable[[_Entry], Fault]] = {
    "encoder_eccentricity": _wave,
    "encoder_harmonic": _wave,
    "encoder_scale": _scale,
    "encoder_temperature": _warm_head,
    "encoder_drift": _zero,
    "count_slip": _slip,
    "encoder_latency": _late,
    "backlash": _play,
    "empirical": _curve,
    "joint_compliance": _joint,
    "bearing_compliance": _bearing,
    "mount_compliance": _mount,
    "thermal_expansion": _elements,
    "axis_wobble": _wobble,
    "axis_runout": _runout,
    "base_drift": _base,
    "base_step": _knock,
    "probe_radius": _ball,
    "probe_lobing": _seats,
    "stylus_bending": _stylus,
}
