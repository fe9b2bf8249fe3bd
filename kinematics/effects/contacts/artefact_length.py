"""A standard that is not as long as its certificate says.

    true length = certified length (1 + 1e-6 error_ppm)

Off-line only: the arm's points do not depend on it, so it corrects no pose.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import Correction

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class ArtefactLength(Correction):
    """One standard, by its id in the campaign."""

    artefact: str

    kind: ClassVar[str] = "artefact_length"

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        del setting
        values = effect.values
        return cls(
            joints=slice(0, 0),
            values=(values["error_ppm"],),
            artefact=values["artefact"],
        )

    @property
    def parameters(self) -> tuple[str, ...]:
        """The one key of the arm file."""
        return ("error_ppm",)

    @property
    def variety(self) -> tuple[str, ...]:
        """The standard."""
        return (self.artefact,)

    def true_length_mm(self, certified_mm: float) -> float:
        """Correct a certified length."""
        return certified_mm * (1.0 + 1e-6 * self.values[0])
