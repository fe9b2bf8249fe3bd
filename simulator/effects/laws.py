"""Forward laws of the effects of an arm file: one for every kind of `[[effects]]`.

A law of readings returns their excess (n, n_chosen joints) or (n, 1). A disc's error
belongs to the line under the head, so to the reading and not to the true turn; the
reading is solved for.

A law of bodies adds to the deflection. A law of touches returns the way (n, 3) from a
perfect ball to the arm's end; in a seat, without a single direction of contact, it is
zero: it would be a constant, or unknown.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.effects.fault import EffectEntry, JointState, Touch
from traverse.simulator.effects.posture import Deflection, Posture


def wavy_disc(entry: EffectEntry, state: JointState) -> Floats:
    """The disc is eccentric, tilted, oval: a sine of the reading."""
    size = np.hypot(entry["cos_rad"], entry["sin_rad"])
    phase = np.arctan2(entry["cos_rad"], entry["sin_rad"])
    order = entry.values.get("order", 1)
    waves: Floats = size * np.sin(order * state.readings_rad[:, entry.joints] + phase)
    return waves


def toothed_drive(entry: EffectEntry, state: JointState) -> Floats:
    """Teeth differ: a phasor turns several times as fast as the reading."""
    turns = entry["cycles"] * state.readings_rad[:, entry.joints] / (2.0 * np.pi)
    phasor = np.exp(2j * np.pi * np.mod(turns, 1.0))
    change_rad: Floats = np.real(complex(entry["cos_rad"], -entry["sin_rad"]) * phasor)
    return change_rad


def long_tape(entry: EffectEntry, state: JointState) -> Floats:
    """Too many lines a radian: grows with the reading from the base posture."""
    joints = entry.joints
    shown_rad = state.readings_rad[:, joints] - state.build.zeros_rad[joints]
    return 1e-6 * entry["scale_ppm"] * shown_rad


def warm_head(entry: EffectEntry, state: JointState) -> Floats:
    warmer_c = state.around.temperature_c - entry.reference_c
    return entry["rate_rad_c"] * warmer_c[:, None]


def creeping_zero(entry: EffectEntry, state: JointState) -> Floats:
    """The zero creeps continuously; nothing at the epoch."""
    return entry["rate_rad_s"] * state.around.since_s(entry.epoch_utc_s)[:, None]


def lost_counts(entry: EffectEntry, state: JointState) -> Floats:
    """Counts are lost at a moment and never found again."""
    since_s = state.around.since_s(entry.epoch_utc_s)
    return np.where(since_s >= entry["at_s"], entry["step_rad"], 0.0)[:, None]


def late_reading(entry: EffectEntry, state: JointState) -> Floats:
    """A joint that moves forwards is shown where it was before."""
    return -entry["latency_s"] * state.around.speed_rad_s[:, entry.joints]


def play(entry: EffectEntry, state: JointState) -> Floats:
    """The encoder runs ahead of the joint in the direction of motion: two-valued."""
    return entry["half_width_rad"] * state.around.approach[:, entry.joints]


def curved_error(entry: EffectEntry, state: JointState) -> Floats:
    """A natural cubic spline in Hermite's pieces, level beyond its outer knots.

    Raises:
        ValueError: If the covariate is no column of a campaign.
    """
    covariate = entry.covariate
    if covariate is None:
        raise ValueError(f"'{entry['covariate']}' is no column of a campaign")
    column, k = covariate
    columns: dict[str, Floats] = {
        "_rad": state.readings_rad[:, k],
        "_speed_rad_s": state.around.speed_rad_s[:, k],
        "_approach": state.around.approach[:, k],
        "time_s": state.around.time_s,
        "force_n": state.around.force_n,
    }
    values = columns.get(column, state.around.temperature_c)
    knots, values_rad = entry.array("knots"), entry.array("values_rad")
    slopes = natural_slopes(entry.values["knots"], entry.values["values_rad"])
    values = np.clip(values, knots[0], knots[-1])
    left = np.searchsorted(knots, values, side="right") - 1
    left = np.clip(left, 0, len(knots) - 2)
    width = np.diff(knots)[left]
    u = (values - knots[left]) / width
    rise = values_rad[left + 1] - values_rad[left]
    first, last = slopes[left] * width, slopes[left + 1] * width
    curve = values_rad[left] + u * (
        first + u * (3.0 * rise - 2.0 * first - last + u * (first + last - 2 * rise))
    )
    return curve[:, None]


@lru_cache(maxsize=64)
def natural_slopes(knots: tuple[float, ...], values: tuple[float, ...]) -> Floats:
    """Return slopes (m,) of the natural cubic spline: no bending at both ends.

    Second derivatives continuous: s_(i-1)/h_(i-1) + 2 s_i (1/h_(i-1) + 1/h_i) +
    s_(i+1)/h_i = 3 (c_(i-1)/h_(i-1) + c_i/h_i), c the slopes of the chords; at the ends
    2 s_0 + s_1 = 3 c_0.
    """
    weights = 1.0 / np.diff(knots)
    pulls = 3.0 * weights**2 * np.diff(values)
    system, right = np.zeros((len(knots), len(knots))), np.zeros(len(knots))
    for i, weight in enumerate(weights.tolist()):
        system[i : i + 2, i : i + 2] += weight * np.array([[2.0, 1.0], [1.0, 2.0]])
    right[:-1] += pulls
    right[1:] += pulls
    return np.asarray(np.linalg.solve(system, right), dtype=np.float64)


def soft_joint(entry: EffectEntry, posture: Posture, yielding: Deflection) -> None:
    """The shaft behind the encoder twists about the axis, down with the weights."""
    joint = entry.joint
    torques_nm = np.einsum(
        "ni,ni->n", posture.moments_nm[:, joint], posture.axis(joint)
    )
    yielding.twists_rad[:, joint] += entry["compliance_rad_nm"] * torques_nm


def soft_bearing(entry: EffectEntry, posture: Posture, yielding: Deflection) -> None:
    """The axis tilts by the part of the weights' moment across it."""
    joint = entry.joint
    across_nm = _across(posture.moments_nm[:, joint], posture.axis(joint))
    tilts = entry["compliance_rad_nm"] * across_nm
    yielding.tilts_rad[joint] += posture.in_carrier(tilts, joint)


def soft_mount(entry: EffectEntry, posture: Posture, yielding: Deflection) -> None:
    """The table tilts by the overturning moment, not about the vertical."""
    gravity = posture.build.gravity_m_s2
    length = np.linalg.norm(gravity)
    if length > 0.0:
        down = np.broadcast_to(gravity / length, (len(posture.turns_rad), 3))
        across_nm = _across(posture.moments_nm[:, 0], down)
        yielding.base_tilts_rad[...] += entry["compliance_rad_nm"] * across_nm


def warm_elements(entry: EffectEntry, posture: Posture, yielding: Deflection) -> None:
    warmer_c = posture.around.temperature_c - entry.reference_c
    yielding.growths[:, entry.joints] += entry["expansion_per_c"] * warmer_c[:, None]


def wobbling_axis(entry: EffectEntry, posture: Posture, yielding: Deflection) -> None:
    """The axis tilts, so many times a turn."""
    yielding.tilts_rad[entry.joint] += _wander(entry, posture, "rad")


def shifting_axis(entry: EffectEntry, posture: Posture, yielding: Deflection) -> None:
    """The axis' origin shifts, so many times a turn."""
    yielding.shifts_mm[entry.joint] += _wander(entry, posture, "mm")


def _wander(entry: EffectEntry, posture: Posture, unit: str) -> Floats:
    """Follow the true turn; the bearing's raceway is fixed to the carrier."""
    phases = entry["order"] * posture.turns_rad[:, entry.joint, None]
    cos, sin = entry.array(f"cos_{unit}"), entry.array(f"sin_{unit}")
    return cos * np.cos(phases) + sin * np.sin(phases)


def creeping_base(entry: EffectEntry, posture: Posture, yielding: Deflection) -> None:
    since_s = posture.around.since_s(entry.epoch_utc_s)
    yielding.base_shifts_mm[...] += since_s[:, None] * entry.array("rate_mm_s")


def knocked_base(entry: EffectEntry, posture: Posture, yielding: Deflection) -> None:
    """The base is knocked once and stays where it then is."""
    knocked = posture.around.since_s(entry.epoch_utc_s) >= entry["at_s"]
    yielding.base_shifts_mm[...] += knocked[:, None] * entry.array("step_mm")


def _across(vectors: Floats, units: Floats) -> Floats:
    """Return components of vectors (n, 3) across units (n, 3)."""
    along = np.einsum("ni,ni->n", vectors, units)
    perpendicular: Floats = vectors - along[:, None] * units
    return perpendicular


def larger_ball(entry: EffectEntry, touch: Touch) -> Floats:
    """The centre of a ball larger than certified stays further off the material."""
    return -entry["radius_error_mm"] * touch.towards


def three_seats(entry: EffectEntry, touch: Touch) -> Floats:
    """The arm moves on until the switch opens, which depends on the side.

    Three seats carry the stylus; it tips over one of them or over two. Azimuths about
    the shank count, in the base posture, from the coordinate axis that is most across
    it, made perpendicular to it.
    """
    directions = np.einsum("nij,ni->nj", touch.motion[:, :3, :3], touch.towards)
    shank = touch.build.mechanism.shank
    second = np.cross(shank, np.eye(3)[np.argmin(np.abs(shank))])
    second /= np.linalg.norm(second)
    azimuths = np.arctan2(directions @ second, directions @ np.cross(second, shank))
    travels_mm = entry["amplitude_mm"] * np.cos(3.0 * azimuths - entry["phase_rad"])
    offsets_mm: Floats = travels_mm[:, None] * touch.towards
    return offsets_mm


def soft_stylus(entry: EffectEntry, touch: Touch) -> Floats:
    """The material holds the ball back, the stylus bends, the arm's end moves on."""
    shanks = touch.motion[:, :3, :3] @ touch.build.mechanism.shank
    along = np.einsum("ni,ni->n", touch.towards, shanks)
    across = touch.towards - along[:, None] * shanks
    bent_mm: Floats = entry["compliance_mm_n"] * touch.force_n[:, None] * across
    return bent_mm


READING_LAWS: dict[str, Callable[[EffectEntry, JointState], Floats]] = {
    "encoder_eccentricity": wavy_disc,
    "encoder_harmonic": wavy_disc,
    "transmission_error": toothed_drive,
    "encoder_scale": long_tape,
    "encoder_temperature": warm_head,
    "encoder_drift": creeping_zero,
    "count_slip": lost_counts,
    "encoder_latency": late_reading,
    "backlash": play,
    "empirical": curved_error,
}
BODY_LAWS: dict[str, Callable[[EffectEntry, Posture, Deflection], None]] = {
    "joint_compliance": soft_joint,
    "bearing_compliance": soft_bearing,
    "mount_compliance": soft_mount,
    "thermal_expansion": warm_elements,
    "axis_wobble": wobbling_axis,
    "axis_runout": shifting_axis,
    "base_drift": creeping_base,
    "base_step": knocked_base,
}
TOUCH_LAWS: dict[str, Callable[[EffectEntry, Touch], Floats]] = {
    "probe_radius": larger_ball,
    "probe_lobing": three_seats,
    "stylus_bending": soft_stylus,
}
# What the weights are, which some of the laws above are about.
OF_MASSES = "first_moment"
PLAYED = {*READING_LAWS, *BODY_LAWS, *TOUCH_LAWS, OF_MASSES}
