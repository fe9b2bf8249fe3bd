"""A standard that is not as long as its certificate says.

    true length = certified length (1 + 1e-6 error_ppm)

Off-line only: the arm's points do not depend on it, so it corrects no pose.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

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
    def surroundings(cls, effect: "Effect", setting: EffectContext) -> dict[str, Any]:
        """Take the standard."""
        del setting
        return {"artefact": effect.values["artefact"]}
