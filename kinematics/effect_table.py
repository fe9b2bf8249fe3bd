"""The table of effects: one row for each kind, with all its properties.

The correction of a kind is its class in `traverse.kinematics.effects`. This table has
its keys, where it can be applied, and values for the laboratory: plausible size,
similar kinds, plots, labels. A new effect needs its class, its row, and the simulator's
own law; another package offers these three by entry points.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import cache, partial
from types import MappingProxyType
from typing import Any, Literal

from traverse.extensions import (
    EFFECT_GROUP,
    broken_extension,
    load_extension,
    offered_extensions,
)

Vector = tuple[float, float, float]
EffectClass = Literal["L", "D", "A", "O"]
JointUse = Literal["required", "optional", "absent"]
RunoutComponent = Literal["radial", "axial"]
ActsOn = Literal["angle", "tilt", "shift", "ball", "base", "length"]
BankUse = Literal["library", "steps", "curves", "periodogram", "none"]


class Family(Enum):
    """Kinds that depend on the same quantity, and are therefore hard to separate."""

    OWN_ANGLE = auto()  # errors of a reading that are functions of that reading
    AXIS_MOTION = auto()  # error motions of a bearing: vectors about the joint's axis
    GRAVITY = auto()  # follow the moments of the arm's own weight
    MASS = auto()  # where the weight is that those follow: moves nothing itself
    WARM = auto()  # follow temperatures
    SLOW = auto()  # change with time
    MOVING = auto()  # follow the last motion
    CONTACT = auto()  # act where the ball touches
    LENGTH = auto()  # of a standard: nothing that the arm does
    CURVE = auto()  # without a physical name


# Families that depend on when, how warm or how fast, rather than on where.
_NOT_OF_POSES = (Family.WARM, Family.SLOW, Family.MOVING, Family.LENGTH)
# Keys with fixed values, not estimated, in the order in which they are named.
_FIXED = ("component", "order", "at_s", "artefact", "covariate", "knots")
# The least order at which an error motion, or a harmonic, is no other kind.
_FIRST_ORDER = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectKind:
    """One row: keys, size and labels of one kind of effect.

    Attributes:
        keys: the kind's own keys and their types, all required.
        size: plausible size of each parameter, in the unit of its key.
        label: for people; may have {often}, {component}, {artefact}.
        effect_class: L: in-line in the daemon; D: if the direction of the surface is
            known; A: bound to time, has `epoch_utc`; O: off-line only.
        joint: whether the effect names a joint.
        acts_on: quantity that it changes; "shift" and "tilt" are of the joint's axis.
        minimum_order: least order, if there is an order.
        components: varieties and the least order of each.
        most: largest values of keys that are above 0.
        size_by_order: the size depends on the order.
        is_size_of_campaign: `size` is the effect over a whole campaign, so that the
            plausible rate is that over its duration.
        phase: key of a phase, which is nonlinear; its size is 1 rad.
        log_prior: preference before the data are used, a natural logarithm.
        log_prior_of_joint: instead, for one of several alike joints.
        log_prior_per_order: for each order above 2.
        covariates: columns of a campaign that it is a function of, {} for the joint:
            the joint's own one first, then the whole arm's.
        is_function: it is a function of that column alone.
        bank: where the diagnosis looks for it; "none": nowhere.
        absorbed_by: equal parameters where a campaign cannot see it.
        whole_arm_label: instead of `label`, for all joints.
    """

    family: Family
    keys: Mapping[str, Any]
    size: float
    label: str
    effect_class: EffectClass = "L"
    joint: JointUse = "required"
    acts_on: ActsOn = "angle"
    minimum_order: int = 1
    components: Mapping[str, int] = field(default_factory=dict)
    most: Mapping[str, float] = field(default_factory=dict)
    size_by_order: Mapping[float, float] = field(default_factory=dict)
    is_size_of_campaign: bool = False
    phase: str | None = None
    log_prior: float = 0.0
    log_prior_of_joint: float | None = None
    log_prior_per_order: float = 0.0
    least_log_prior: float = -float("inf")
    covariates: tuple[str, ...] = ()
    is_function: bool = True
    bank: BankUse = "library"
    absorbed_by: str = "a change of the geometry or of the artefacts' places"
    whole_arm_label: str | None = None

    def __post_init__(self) -> None:
        for name in ("keys", "components", "most", "size_by_order"):
            frozen = MappingProxyType(dict(getattr(self, name)))
            object.__setattr__(self, name, frozen)

    @property
    def has_order(self) -> bool:
        return "order" in self.keys

    @property
    def fixed(self) -> tuple[str, ...]:
        """Keys with fixed values: order, epoch."""
        return tuple(key for key in (*_FIXED, *self.most) if key in self.keys)

    @property
    def sizes(self) -> tuple[str, ...]:
        return tuple(key for key in self.keys if key not in self.fixed)

    @property
    def vectors(self) -> tuple[str, ...]:
        return tuple(key for key, of in self.keys.items() if of is Vector)

    @property
    def is_about_axis(self) -> bool:
        """Whether its vectors lie across or along the axis of the joint."""
        return self.family is Family.AXIS_MOTION

    @property
    def is_wave(self) -> bool:
        return self.family is Family.OWN_ANGLE and "cos_rad" in self.keys

    @property
    def turns_with_joint(self) -> bool:
        """Whether it is periodic in the joint: two of them fit nearly any curve."""
        return self.family in (Family.OWN_ANGLE, Family.AXIS_MOTION)

    @property
    def depends_on_posture(self) -> bool:
        return self.family not in _NOT_OF_POSES

    def least_order(self, component: object = None) -> int:
        return self.components.get(str(component), self.minimum_order)

    def plausible_size(self, order: float | None = None) -> float:
        """Return the plausible size of a parameter, in the unit of its key."""
        if order is None:
            return self.size
        return self.size_by_order.get(order, self.size)

    def preference(self, joint: str | None, order: int | None) -> float:
        """Return its preference before the data are used.

        Args:
            joint: name, or None for the whole arm.
            order: of a harmonic or of an error motion, or None.

        Returns:
            Natural logarithm, 0 for the usual ones, negative for unusual ones.
        """
        plain = self.log_prior
        if joint is not None and self.log_prior_of_joint is not None:
            plain = self.log_prior_of_joint
        above = max((order or _FIRST_ORDER) - _FIRST_ORDER, 0)
        return max(plain + self.log_prior_per_order * above, self.least_log_prior)

    def columns(self, joint: str | None) -> tuple[str, ...]:
        of_arm = joint is None
        return tuple(
            column.format(joint)
            for column in self.covariates
            if not (of_arm and "{" in column)
        )


_SPLINE = {
    "covariate": str,
    "knots": tuple[float, ...],
    "values_rad": tuple[float, ...],
}

# What the kinds of a family share.
_own_angle = partial(EffectKind, family=Family.OWN_ANGLE, covariates=("{}_rad",))
_axis_motion = partial(
    EffectKind,
    family=Family.AXIS_MOTION,
    log_prior=-1.0,
    log_prior_per_order=-0.5,
    covariates=("{}_rad",),
    is_function=False,
)
_gravity = partial(
    EffectKind, family=Family.GRAVITY, keys={"compliance_rad_nm": float}, size=1e-5
)
_warm = partial(
    EffectKind,
    family=Family.WARM,
    size=1e-5,
    covariates=("{}_temperature_c", "temperature_c"),
)
_slow = partial(
    EffectKind, family=Family.SLOW, effect_class="A", covariates=("time_s",)
)
_base = partial(_slow, joint="absent", acts_on="base", size=0.03)
_contact = partial(
    EffectKind,
    family=Family.CONTACT,
    effect_class="D",
    joint="absent",
    acts_on="ball",
)


class EffectKinds(Mapping[str, EffectKind]):
    """The kinds of Traverse, and those that other packages offer."""

    def __init__(self, built_in: Mapping[str, EffectKind]) -> None:
        self.built_in = built_in

    def __getitem__(self, kind: str) -> EffectKind:
        row = self.built_in.get(kind)
        return _row_of_extension(kind) if row is None else row

    def __contains__(self, kind: object) -> bool:
        return kind in self.built_in or kind in offered_extensions(EFFECT_GROUP)

    def __iter__(self) -> Iterator[str]:
        offered = offered_extensions(EFFECT_GROUP)
        return iter(dict.fromkeys((*self.built_in, *offered)))

    def __len__(self) -> int:
        return len(tuple(iter(self)))


@cache
def _row_of_extension(kind: str) -> EffectKind:
    correction = load_extension(EFFECT_GROUP, kind, type)
    row = getattr(correction, "row", None)
    if isinstance(row, EffectKind) and getattr(correction, "kind", None) == kind:
        return row
    raise broken_extension(
        EFFECT_GROUP,
        offered_extensions(EFFECT_GROUP)[kind][0],
        f"lacks kind = {kind!r} or row, an EffectKind",
    )


EFFECT_KINDS = EffectKinds(
    {
        "encoder_eccentricity": _own_angle(
            keys={"cos_rad": float, "sin_rad": float},
            size=3e-5,
            label="encoder eccentricity",
        ),
        "encoder_harmonic": _own_angle(
            keys={"order": int, "cos_rad": float, "sin_rad": float},
            minimum_order=2,
            size=5e-6,  # of sub-division errors
            size_by_order={2: 2e-5, 3: 1e-5, 4: 1e-5},
            log_prior=-1.0,
            log_prior_per_order=-1.0,
            least_log_prior=-3.0,
            label="encoder error {often} a turn",
        ),
        "transmission_error": _own_angle(
            keys={"cycles": float, "cos_rad": float, "sin_rad": float},
            most={"cycles": 400.0},
            size=2e-5,
            log_prior=-1.0,
            bank="periodogram",
            label="transmission error {cycles:.4g} times a turn",
        ),
        "encoder_scale": _own_angle(
            keys={"scale_ppm": float}, size=20.0, label="encoder scale"
        ),
        "encoder_temperature": _warm(
            keys={"rate_rad_c": float},
            log_prior=-0.5,
            label="encoder zero with temperature",
        ),
        "encoder_drift": _slow(
            keys={"rate_rad_s": float},
            size=3e-5,
            is_size_of_campaign=True,
            label="drift of the encoder's zero",
        ),
        "count_slip": _slow(
            keys={"at_s": float, "step_rad": float},
            size=5e-5,
            bank="steps",
            label="jump of the encoder's zero",
        ),
        "encoder_latency": EffectKind(
            family=Family.MOVING,
            joint="optional",
            keys={"latency_s": float},
            size=1e-4,
            log_prior_of_joint=-0.7,
            covariates=("{}_speed_rad_s",),
            label="latency of readings",
            whole_arm_label="latency of all readings",
        ),
        "backlash": EffectKind(
            family=Family.MOVING,
            keys={"half_width_rad": float},
            size=1e-5,
            covariates=("{}_approach",),
            absorbed_by="the zero of {joint}: approach it from both sides",
            label="backlash",
        ),
        "joint_compliance": _gravity(label="torsion under gravity"),
        "bearing_compliance": _gravity(
            acts_on="tilt", log_prior=-0.5, label="tilt of the bearing under gravity"
        ),
        "mount_compliance": _gravity(
            joint="absent", acts_on="base", label="tilt of the mount under gravity"
        ),
        "first_moment": EffectKind(
            family=Family.MASS,
            keys={"moment_kg_m": Vector},
            size=1.0,
            bank="none",
            label="first moment of mass",
        ),
        "thermal_expansion": _warm(
            joint="optional",
            keys={"expansion_per_c": float},
            acts_on="length",
            log_prior_of_joint=-0.7,
            label="thermal expansion of the link",
            whole_arm_label="thermal expansion of all links",
        ),
        "axis_wobble": _axis_motion(
            keys={"order": int, "cos_rad": Vector, "sin_rad": Vector},
            minimum_order=2,
            acts_on="tilt",
            size=1e-5,
            label="wobble of the axis {often} a turn",
        ),
        "axis_runout": _axis_motion(
            keys={
                "component": RunoutComponent,
                "order": int,
                "cos_mm": Vector,
                "sin_mm": Vector,
            },
            components={"radial": 2, "axial": 1},
            acts_on="shift",
            size=0.01,
            label="{component} runout {often} a turn",
        ),
        "probe_radius": _contact(
            keys={"radius_error_mm": float},
            size=0.01,
            absorbed_by="the unknown sizes of the touched surfaces",
            label="radius of the probe's ball",
        ),
        "probe_lobing": _contact(
            keys={"amplitude_mm": float, "phase_rad": float},
            size=0.005,
            phase="phase_rad",
            label="lobing of the probe",
        ),
        "stylus_bending": _contact(
            keys={"compliance_mm_n": float}, size=0.01, label="bending of the stylus"
        ),
        "base_drift": _base(
            keys={"rate_mm_s": Vector},
            is_size_of_campaign=True,
            label="drift of the base",
        ),
        "base_step": _base(
            keys={"at_s": float, "step_mm": Vector},
            bank="steps",
            label="step of the base",
        ),
        "artefact_length": EffectKind(
            family=Family.LENGTH,
            effect_class="O",
            joint="absent",
            keys={"artefact": str, "error_ppm": float},
            acts_on="length",
            size=10.0,
            absorbed_by="the arm's scale",
            label="length of {artefact}",
        ),
        "empirical": EffectKind(
            family=Family.CURVE,
            keys=_SPLINE,
            size=1e-5,
            bank="curves",
            label="something over {covariate}",
        ),
    }
)

KEY_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "scale_ppm": "ppm",
        "error_ppm": "ppm",
        "rate_rad_c": "rad/C",
        "rate_rad_s": "rad/s",
        "latency_s": "s",
        "compliance_rad_nm": "rad/(N m)",
        "moment_kg_m": "kg m",
        "expansion_per_c": "1/C",
        "compliance_mm_n": "mm/N",
        "rate_mm_s": "mm/s",
    }
)
"""Units of keys other than the `_rad` or `_mm` at their ends."""


def key_unit(key: str) -> str:
    """Return the unit of a key of `[[effects]]`."""
    unit = KEY_UNITS.get(key)
    if unit is None:
        stem, _, unit = key.rpartition("_")
        if not stem or unit not in ("rad", "mm"):
            raise ValueError(f"{key} has no unit in the table of effects")
    return unit
