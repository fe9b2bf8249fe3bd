"""Make the fault of each kind of effect."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from traverse.simulator.effects import body_faults, encoder_faults, touch_faults
from traverse.simulator.effects.empirical_fault import (
    OF_ARM,
    OF_JOINT,
    CurvedError,
    natural_slopes,
)
from traverse.simulator.effects.fault import Fault


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


def covariate_of(entry: EffectEntry) -> tuple[str, int] | None:
    """Column and joint (-1 for none) of an empirical effect."""
    name = str(entry.values["covariate"])
    if name in OF_ARM:
        return name, -1
    for number, joint in enumerate(entry.names):
        if name.startswith(joint) and name.removeprefix(joint) in OF_JOINT:
            return name.removeprefix(joint), number
    return None


def _wave(entry: EffectEntry) -> Fault:
    v = entry.values
    return encoder_faults.WavyDisc(
        entry.joints, v.get("order", 1), v["cos_rad"], v["sin_rad"]
    )


def _teeth(entry: EffectEntry) -> Fault:
    v = entry.values
    return encoder_faults.ToothedDrive(
        entry.joints, v["cycles"], v["cos_rad"], v["sin_rad"]
    )


def _scale(entry: EffectEntry) -> Fault:
    return encoder_faults.LongTape(entry.joints, entry.values["scale_ppm"])


def _warm_head(entry: EffectEntry) -> Fault:
    rate = entry.values["rate_rad_c"]
    return encoder_faults.WarmHead(entry.joints, rate, entry.reference_c)


def _zero(entry: EffectEntry) -> Fault:
    rate = entry.values["rate_rad_s"]
    return encoder_faults.CreepingZero(entry.joints, rate, entry.epoch_utc_s)


def _slip(entry: EffectEntry) -> Fault:
    v = entry.values
    return encoder_faults.LostCounts(
        entry.joints, v["step_rad"], v["at_s"], entry.epoch_utc_s
    )


def _late(entry: EffectEntry) -> Fault:
    return encoder_faults.LateReading(entry.joints, entry.values["latency_s"])


def _play(entry: EffectEntry) -> Fault:
    return encoder_faults.Play(entry.joints, entry.values["half_width_rad"])


def _curve(entry: EffectEntry) -> Fault:
    found = covariate_of(entry)
    if found is None:
        raise ValueError(f"'{entry.values['covariate']}' is no column of a campaign")
    knots = np.array(entry.values["knots"], dtype=np.float64)
    values_rad = np.array(entry.values["values_rad"], dtype=np.float64)
    slopes = natural_slopes(knots, values_rad)
    return CurvedError(entry.joints, *found, knots, values_rad, slopes)


def _joint(entry: EffectEntry) -> Fault:
    return body_faults.SoftJoint(entry.joint, entry.values["compliance_rad_nm"])


def _bearing(entry: EffectEntry) -> Fault:
    return body_faults.SoftBearing(entry.joint, entry.values["compliance_rad_nm"])


def _mount(entry: EffectEntry) -> Fault:
    return body_faults.SoftMount(entry.values["compliance_rad_nm"])


def _elements(entry: EffectEntry) -> Fault:
    rate = entry.values["expansion_per_c"]
    return body_faults.WarmElements(entry.joints, rate, entry.reference_c)


def _wobble(entry: EffectEntry) -> Fault:
    v = entry.values
    cos, sin = np.array(v["cos_rad"]), np.array(v["sin_rad"])
    return body_faults.WanderingAxis(entry.joint, True, v["order"], cos, sin)


def _runout(entry: EffectEntry) -> Fault:
    v = entry.values
    cos, sin = np.array(v["cos_mm"]), np.array(v["sin_mm"])
    return body_faults.WanderingAxis(entry.joint, False, v["order"], cos, sin)


def _base(entry: EffectEntry) -> Fault:
    rate = np.array(entry.values["rate_mm_s"])
    return body_faults.CreepingBase(rate, entry.epoch_utc_s)


def _knock(entry: EffectEntry) -> Fault:
    v = entry.values
    return body_faults.KnockedBase(np.array(v["step_mm"]), v["at_s"], entry.epoch_utc_s)


def _ball(entry: EffectEntry) -> Fault:
    return touch_faults.LargerBall(entry.values["radius_error_mm"])


def _seats(entry: EffectEntry) -> Fault:
    return touch_faults.ThreeSeats(
        entry.values["amplitude_mm"], entry.values["phase_rad"]
    )


def _stylus(entry: EffectEntry) -> Fault:
    return touch_faults.SoftStylus(entry.values["compliance_mm_n"])


MAKERS: Mapping[str, Callable[[EffectEntry], Fault]] = {
    "encoder_eccentricity": _wave,
    "encoder_harmonic": _wave,
    "transmission_error": _teeth,
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
