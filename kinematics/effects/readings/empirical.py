"""A curve where no named effect fits: d_alpha is a spline of a covariate.

The covariate is named like a column of a campaign: `<joint>_rad`, `temperature_c`,
`<joint>_temperature_c`, `<joint>_speed_rad_s`, `<joint>_approach`, `force_n`, `time_s`.
The spline is natural cubic; beyond the outer knots its last value is held, the sample
flagged `beyond_knots`, and the difference to a straight continuation is its
uncertainty. Every sample is flagged `empirical`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.effects.base.block import COLUMNS, Block, Covariate, Need
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import FlagName, ReadingCorrection
from traverse.kinematics.effects.readings.spline import (
    spline_amounts,
    spline_numbers,
    straight_on,
)
from traverse.kinematics.kernel.terms import Form, Quantity, Source, Term
from traverse.kinematics.model.geometry import Geometry

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect

_OF_ARM = {
    "time_s": Covariate.CAMPAIGN_TIME,
    "temperature_c": Covariate.TEMPERATURE,
    "force_n": Covariate.FORCE,
}
_OF_JOINT = {
    "_temperature_c": Covariate.TEMPERATURE,
    "_speed_rad_s": Covariate.SPEED,
    "_approach": Covariate.APPROACH,
    "_rad": None,
}

_SOURCES = {
    None: Source.READING,
    Covariate.CAMPAIGN_TIME: Source.CAMPAIGN,
    Covariate.TEMPERATURE: Source.TEMPERATURE,
    Covariate.FORCE: Source.FORCE,
    Covariate.SPEED: Source.SPEED,
    Covariate.APPROACH: Source.APPROACH,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Empirical(ReadingCorrection):
    """A spline of a covariate.

    Attributes:
        knots: in the unit of the covariate.
        source: the covariate; None for a reading.
        source_joint: of the covariate; None for one of the whole arm.
    """

    knots: tuple[float, ...]
    source: Covariate | None
    source_joint: int | None

    kind: ClassVar[str] = "empirical"

    @classmethod
    def surroundings(cls, effect: "Effect", setting: EffectContext) -> dict[str, Any]:
        """Find the covariate among the arm's."""
        covariate = effect.values["covariate"]
        source, source_joint = _source(covariate, setting)
        return {
            "knots": effect.values["knots"],
            "source": source,
            "source_joint": source_joint,
        }

    @property
    def parameters(self) -> tuple[str, ...]:
        """The values at the knots, from 1."""
        return tuple(f"values_rad.{n}" for n in range(1, len(self.knots) + 1))

    @property
    def needs(self) -> tuple[Need, ...]:
        """The covariate, where it is not a reading."""
        return () if self.source is None else (Need(self.source, self.source_joint),)

    def flags(self, block: Block) -> Iterator[tuple[FlagName, Booleans]]:
        """Flag all samples, and those beyond the outer knots."""
        readings = self._covariate(block)
        yield "empirical", np.ones(len(block), dtype=np.bool_)
        yield "beyond_knots", (readings < self.knots[0]) | (readings > self.knots[-1])

    def unit_amounts(self, geometry: Geometry, block: Block) -> Floats:
        """The unit splines, (n_knots, 1, n_samples)."""
        del geometry
        return spline_amounts(self.knots, self._covariate(block))[:, np.newaxis]

    def unseen_rad(self, block: Block) -> Floats | None:
        """Return the difference between straight continuation and held value."""
        away_rad = np.abs(straight_on(self.knots, self.values, self._covariate(block)))
        return away_rad if away_rad.any() else None

    @property
    def terms(self) -> tuple[Term, ...]:
        of = Quantity(_SOURCES[self.source], self.source_joint)
        spline = spline_numbers(self.knots, self.values)
        return tuple(
            Term(form=Form.READING_SPLINE, joint=joint, of=of, spline=spline)
            for joint in self.affected
        )

    def _covariate(self, block: Block) -> Floats:
        column = "angles_rad" if self.source is None else COLUMNS[self.source]
        if self.source_joint is None:
            return block.row(column)
        joints = slice(self.source_joint, self.source_joint + 1)
        if self.source is Covariate.TEMPERATURE:
            rows = block.temperatures_c(joints)
        else:
            rows = block.rows(column, joints)
        row: Floats = rows[0]
        return row


def _source(
    covariate: str, setting: EffectContext
) -> tuple[Covariate | None, int | None]:
    for joint, name in enumerate(setting.joint_names):
        of = covariate.removeprefix(name)
        if covariate.startswith(name) and of in _OF_JOINT:
            return _OF_JOINT[of], joint
    if covariate in _OF_ARM:
        return _OF_ARM[covariate], None
    raise ValueError(
        f"empirical: covariate {covariate!r} is none that samples carry; expected "
        f"{', '.join(_OF_ARM)} or a joint ({', '.join(setting.joint_names)}) followed "
        f"by {', '.join(_OF_JOINT)}"
    )
