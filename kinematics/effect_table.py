"""The kinds of effects an arm file may hold: one entry a kind.

What each kind corrects stands in its own file in `traverse.kinematics.effects`; this
table says how it is written down and where it can be applied.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

Vector = tuple[float, float, float]
EffectClass = Literal["L", "D", "A", "O"]
JointUse = Literal["required", "optional", "absent"]
RunoutComponent = Literal["radial", "axial"]


@dataclass(frozen=True, slots=True)
class EffectKind:
    """How one kind of effect is written.

    Attributes:
        effect_class: L: in-line in the daemon; D: where the direction of the
            surface is known; A: bound to time, has `epoch_utc`; O: off-line only.
        joint: Whether the effect names a joint.
        keys: The kind's own keys and their types, all required.
        minimum_order: Least harmonic order, where there is an order.
    """

    effect_class: EffectClass
    joint: JointUse
    keys: Mapping[str, Any]
    minimum_order: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "keys", MappingProxyType(dict(self.keys)))


_HARMONIC = {"order": int, "cos_rad": float, "sin_rad": float}
_WOBBLE = {"order": int, "cos_rad": Vector, "sin_rad": Vector}
_RUNOUT = {
    "component": RunoutComponent,
    "order": int,
    "cos_mm": Vector,
    "sin_mm": Vector,
}
_COMPLIANCE = {"compliance_rad_nm": float}
_LOBING = {"amplitude_mm": float, "phase_rad": float}
_SPLINE = {
    "covariate": str,
    "knots": tuple[float, ...],
    "values_rad": tuple[float, ...],
}

EFFECT_KINDS: Mapping[str, EffectKind] = MappingProxyType(
    {
        "encoder_eccentricity": EffectKind(
            "L", "required", {"cos_rad": float, "sin_rad": float}
        ),
        "encoder_harmonic": EffectKind("L", "required", _HARMONIC, minimum_order=2),
        "encoder_scale": EffectKind("L", "required", {"scale_ppm": float}),
        "encoder_temperature": EffectKind("L", "required", {"rate_rad_c": float}),
        "encoder_drift": EffectKind("A", "required", {"rate_rad_s": float}),
        "count_slip": EffectKind("A", "required", {"at_s": float, "step_rad": float}),
        "encoder_latency": EffectKind("L", "optional", {"latency_s": float}),
        "backlash": EffectKind("L", "required", {"half_width_rad": float}),
        "joint_compliance": EffectKind("L", "required", _COMPLIANCE),
        "bearing_compliance": EffectKind("L", "required", _COMPLIANCE),
        "mount_compliance": EffectKind("L", "absent", _COMPLIANCE),
        "thermal_expansion": EffectKind("L", "optional", {"expansion_per_c": float}),
        "axis_wobble": EffectKind("L", "required", _WOBBLE, minimum_order=2),
        "axis_runout": EffectKind("L", "required", _RUNOUT),
        "probe_radius": EffectKind("D", "absent", {"radius_error_mm": float}),
        "probe_lobing": EffectKind("D", "absent", _LOBING),
        "stylus_bending": EffectKind("D", "absent", {"compliance_mm_n": float}),
        "base_drift": EffectKind("A", "absent", {"rate_mm_s": Vector}),
        "base_step": EffectKind("A", "absent", {"at_s": float, "step_mm": Vector}),
        "artefact_length": EffectKind(
            "O", "absent", {"artefact": str, "error_ppm": float}
        ),
        "empirical": EffectKind("L", "required", _SPLINE),
    }
)
