"""A reading that follows the temperature.

    d_alpha = rate_rad_c (T - T_ref)

T is the joint's own temperature where it is known, else the arm's.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.covariate import Covariate, Need
from traverse.kinematics.effects.readings.single_rate import SingleRate
from traverse.kinematics.kernel.terms import Quantity, Source
from traverse.kinematics.model.geometry import Geometry

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderTemperature(SingleRate):
    """Proportional to the distance from the reference temperature."""

    reference_c: float

    kind: ClassVar[str] = "encoder_temperature"

    @classmethod
    def surroundings(cls, effect: "Effect", setting: EffectContext) -> dict[str, Any]:
        """Take the reference temperature."""
        del effect
        return {"reference_c": setting.reference_temperature_c}

    @property
    def needs(self) -> tuple[Need, ...]:
        """The joint's temperature."""
        return (Need(Covariate.TEMPERATURE, self.joints.start),)

    def regressor(self, geometry: Geometry, block: Block) -> Floats:
        """T - T_ref, (1, n_samples)."""
        del geometry
        return block.temperatures_c(self.joints) - self.reference_c

    def quantity(self, joint: int) -> Quantity:
        """T - T_ref."""
        return Quantity(Source.TEMPERATURE, joint, self.reference_c)
