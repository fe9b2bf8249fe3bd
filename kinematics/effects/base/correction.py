"""Base class of effects, and the three families of those that move a pose.

A correction is linear in its values (amplitudes): it is the sum of value times unit
amount. That one formula a kind gives both the correction and its derivatives.

    family    depends on                   corrects
    reading   readings and covariates      d_alpha, which is taken from the reading
    body      the undeflected posture      turns, tilts, places and lengths of bodies
    contact   the final pose, the surface  the ball's centre
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from enum import Enum, auto
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.base.block import Block, Covariate, Need
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.kernel.terms import Term
from traverse.kinematics.model.geometry import Geometry

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect
    from traverse.kinematics.effects.base.contact import Contact
    from traverse.kinematics.effects.base.posture import Posture

FlagName = Literal["stale_effect", "surface_unknown", "empirical", "beyond_knots"]


class Target(Enum):
    """Target of a body correction, and the shape of its amounts."""

    TURN = auto()  # theta grows: rad, (n_chosen, n_samples)
    TILT = auto()  # the body turns about the joint's origin: rad, (3, n_chosen, n)
    SHIFT = auto()  # the joint's origin moves: mm, (3, n_chosen, n_samples)
    GROWTH = auto()  # the element grows by this fraction, (n_chosen, n_samples)
    MOUNT = auto()  # everything turns about origin_mm: rad, (3, n_samples)
    BASE = auto()  # x_0 moves: mm, (3, n_samples)


@dataclass(frozen=True, slots=True, kw_only=True)
class Correction(ABC):
    """An effect of an arm file, ready to be applied.

    Tilts and shifts are vectors of the body that carries the joint, written in the
    base posture: P_(k-1) takes them to where they are.

    Attributes:
        joints: The affected joints, counted from 0; empty where there are none.
        values: Of the parameters, in the order of `parameters`.
        variety: Distinguishes it from others of its kind on the same joint.
    """

    joints: slice
    values: tuple[float, ...]
    variety: tuple[str, ...] = ()

    kind: ClassVar[str]
    uses_gravity: ClassVar[bool] = False
    covariate: ClassVar[Covariate | None] = None

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        row, entries = EFFECT_KINDS[cls.kind], effect.values
        values: list[float] = []
        for key in row.sizes:
            values += (
                entries[key] if isinstance(entries[key], tuple) else [entries[key]]
            )
        return cls(
            joints=slice(0, 0) if row.joint == "absent" else setting.joints(effect),
            values=tuple(values),
            variety=tuple(_shown(k, entries[k]) for k in row.fixed if k != "knots"),
            **cls.surroundings(effect, setting),
        )

    @classmethod
    def surroundings(cls, effect: "Effect", setting: EffectContext) -> dict[str, Any]:
        """Return further fields of a class, from the entry or the arm."""
        about = {"reference_temperature_c": setting.reference_temperature_c}
        known = {**about, **effect.values}
        return {
            field.name: known[field.name]
            for field in fields(cls)
            if field.name in known
        }

    @property
    def parameters(self) -> tuple[str, ...]:
        """Keys of the arm file, `.x .y .z` or `.1 .2 ...` for parts of arrays."""
        row = EFFECT_KINDS[self.kind]
        parts = dict.fromkeys(row.vectors, ("x", "y", "z"))
        return tuple(
            f"{key}.{part}" if part else key
            for key in row.sizes
            for part in parts.get(key, ("",))
        )

    @property
    def affected(self) -> range:
        return range(self.joints.start, self.joints.stop)

    @property
    def needs(self) -> tuple[Need, ...]:
        if self.covariate is None or self.covariate is Covariate.UTC:
            return () if self.covariate is None else (Need(self.covariate),)
        return tuple(Need(self.covariate, joint) for joint in self.affected)

    def flags(self, block: Block) -> Iterator[tuple[FlagName, Booleans]]:
        """Yield flags with the samples concerned, each (n_samples,)."""
        yield from ()

    def free_directions(self, geometry: Geometry) -> Floats:
        """Return the changes of values that the law of the kind allows.

        Returns:
            Orthonormal columns, (n_parameters, n_free).
        """
        del geometry  # only those with vectors about an axis ask
        return np.eye(len(self.values))

    def with_values(self, values: Floats) -> Self:
        """Return the same effect with other values, (n_parameters,)."""
        if values.shape != (len(self.values),):
            raise ValueError(
                f"{self.kind}: values have shape {values.shape}, expected "
                f"({len(self.values)},) for {', '.join(self.parameters)}"
            )
        return replace(self, values=tuple(values.tolist()))

    @property
    def keys(self) -> dict[str, Any]:
        """The values under the keys of the arm file, arrays as tuples."""
        values: dict[str, Any] = {}
        for parameter, value in zip(self.parameters, self.values, strict=True):
            key, dot, _ = parameter.partition(".")
            values[key] = (*values.get(key, ()), value) if dot else value
        return values


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingCorrection(Correction):
    """Correction of the readings: theta = alpha - zero - d_alpha."""

    @abstractmethod
    def unit_amounts(self, geometry: Geometry, block: Block) -> Floats:
        """d_alpha for each value 1, (n_parameters, n_chosen, n_samples)."""

    def amount(self, geometry: Geometry, block: Block) -> Floats:
        return weighted_sum(self.values, self.unit_amounts(geometry, block))

    def unseen_rad(self, block: Block) -> Floats | None:
        """Standard deviations of d_alpha beyond the campaign's range, (n_samples,).

        None if no sample is beyond.
        """
        del block
        return None

    @property
    @abstractmethod
    def terms(self) -> tuple[Term, ...]:
        """The same for the kernel in C."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyCorrection(Correction):
    """Motion of the arm's bodies beyond turning about their axes."""

    target: ClassVar[Target]

    @abstractmethod
    def unit_amounts(self, posture: "Posture") -> Floats:
        """Correction for each value 1, (n_parameters, *shape of the target)."""

    def amount(self, posture: "Posture") -> Floats:
        return weighted_sum(self.values, self.unit_amounts(posture))

    @property
    @abstractmethod
    def terms(self) -> tuple[Term, ...]:
        """The same for the kernel in C."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactCorrection(Correction):
    """Correction at the contact of the ball; zero where the surface is unknown."""

    def flags(self, block: Block) -> Iterator[tuple[FlagName, Booleans]]:
        if block.directions is None:
            yield "surface_unknown", np.ones(len(block), dtype=np.bool_)
        else:
            x, y, z = np.isnan(block.directions).T
            yield "surface_unknown", x | y | z

    @abstractmethod
    def derivatives(self, contact: "Contact") -> Floats:
        """Return derivatives of the ball's shift, (n_parameters, 3, n)."""

    def amount(self, contact: "Contact") -> Floats:
        """Return the shift of the ball's centre in mm, (3, n_samples)."""
        return weighted_sum(self.values, self.derivatives(contact))


def _shown(key: str, value: object) -> str:
    """Format a fixed key for the name of an effect."""
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{text}s" if key == "at_s" else text


def weighted_sum(values: tuple[float, ...], amounts: Floats) -> Floats:
    """Sum value times amount in a fixed order.

    A matrix product's order of adding depends on the number of samples, and with it the
    last bit.
    """
    total: Floats = values[0] * amounts[0]
    for value, amount in zip(values[1:], amounts[1:], strict=True):
        total += value * amount
    return total
