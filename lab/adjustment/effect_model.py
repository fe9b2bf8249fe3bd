"""Effects in an adjustment: which are applied, and how their values may move.

Values are those of the arm file's keys. They move along `free_directions`: a vector
across an axis has three values but two freedoms, called v and w; one along it has the
one called u.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.arm_file.arm import Arm, Effect
from traverse.kinematics.effect_table import EFFECT_KINDS, key_unit
from traverse.kinematics.effects.arm_effects import ArmEffects, effects_of
from traverse.kinematics.effects.base.correction import Correction
from traverse.kinematics.effects.columns import columns
from traverse.kinematics.effects.contacts.touching import ArtefactLength
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.poses import Poses
from traverse.lab.first_moments import AssumedMoments, assumed_moments, states_no_mass

# A direction with a larger standard deviation (in plausible sizes) is held.
_HOPELESS = 50.0


@dataclass(frozen=True, slots=True, eq=False)
class EffectModel:
    """The effects of an adjustment with what surrounds the poses.

    Attributes:
        effects: With the values to begin with.
        names: Of the coordinates along which values move, (n_coordinates,).
        tolerances: Hopeless standard deviations of the coordinates.
        campaign: That is adjusted.
        assumed: First moments of an arm without masses, or None.
    """

    effects: ArmEffects
    names: tuple[str, ...]
    units: tuple[str, ...]
    tolerances: Floats
    campaign: Campaign
    assumed: AssumedMoments | None = None

    def at(self, values: Floats) -> ArmEffects:
        """Make the effects of some sizes, (n_values,)."""
        return self.effects.with_values(values)

    def coordinates(self, geometry: Geometry, index: int) -> slice:
        """Find the coordinates of an effect among those of all."""
        corrections = self.effects.corrections
        sizes = [
            correction.free_directions(geometry).shape[1] for correction in corrections
        ]
        return slice(sum(sizes[:index]), sum(sizes[: index + 1]))

    def directions(self, geometry: Geometry) -> Floats:
        """Return how values move with coordinates, (n_values, n_coordinates)."""
        directions = np.zeros((len(self.effects.values), len(self.names)))
        row = 0
        for index, correction in enumerate(self.effects.corrections):
            part = correction.free_directions(geometry)
            directions[row : row + len(part), self.coordinates(geometry, index)] = part
            row += len(part)
        return directions

    def columns(
        self, geometry: Geometry, values: Floats, poses: Poses, *, turns: bool = False
    ) -> Floats:
        """Compute the derivatives of x, (n_poses, 3, n_coordinates).

        Or, with turns, of the orientation of the last body.
        """
        block = self.campaign.block(poses)
        by_values = columns(geometry, self.at(values), block, turns=turns)
        return by_values @ self.directions(geometry)

    @property
    def moments(self) -> list[int]:
        """Coordinates that are first moments of mass."""
        weighing = {self.effects.name(moment) for moment in self.effects.first_moments}
        return [n for n, x in enumerate(self.names) if x.rsplit(".", 2)[0] in weighing]

    def moments_with(self, free: Collection[str]) -> tuple[str, ...]:
        """Name the first moments that belong to free coordinates of compliances.

        None where the masses are known.
        """
        effects = self.effects
        yielding = [effects.name(c) for c in effects.corrections if c.uses_gravity]
        if self.assumed is None or not any(
            name.rpartition(".")[0] in yielding for name in free
        ):
            return ()
        return tuple(self.names[moment] for moment in self.moments)

    def expectations(self, values: Floats, free: Booleans) -> Floats:
        """White equations of what is expected of free first moments.

        Of all coordinates, of which some are free, (n_coordinates,); the right side is
        last, (n, n_coordinates + 1).
        """
        moments = self.moments
        equations = np.zeros((len(moments) + 1, len(self.names) + 1))
        if self.assumed is None or not np.any(free[moments]):
            return equations[:0]
        rows = self.assumed.expectations(self.at(values).first_moments)
        equations[:, [*moments, -1]] = rows
        return equations[[*free[moments], True]]

    def length_errors(self, values: Floats, artefact: str) -> tuple[float, Floats]:
        """Return by how many ppm a standard is longer than its certificate says.

        And how that moves with the coordinates, (n_coordinates,).
        """
        total_ppm, coordinate = 0.0, 0
        by_coordinates = np.zeros(len(self.names))
        for correction in self.at(values).corrections:
            if (
                isinstance(correction, ArtefactLength)
                and correction.artefact == artefact
            ):
                total_ppm += correction.values[0]
                by_coordinates[coordinate] = 1.0
            coordinate += len(_coordinate_names(correction))
        return total_ppm, by_coordinates


def effect_model(
    arm: Arm, effects: tuple[Effect, ...], campaign: Campaign
) -> EffectModel:
    """Prepare effects for the adjustment of a campaign.

    Of the arm joints and masses are looked at, not its own effects.

    Raises:
        ValueError: Effects do not fit the arm, or need what the campaign does not
            tell.
    """
    built = effects_of(arm, effects, campaign.span)
    names: list[str] = []
    units: list[str] = []
    tolerances: list[float] = []
    for correction in built.corrections:
        coordinates = _coordinate_names(correction)
        prefix = built.name(correction)
        names += [f"{prefix}.{name}" for name in coordinates]
        units += [key_unit(name.partition(".")[0]) for name in coordinates]
        # A vector about an axis has more components than freedoms, of one size.
        sizes = campaign.plausible_values(correction)[: len(coordinates)]
        tolerances += [_HOPELESS * size for size in sizes]
    model = EffectModel(
        effects=built,
        names=tuple(names),
        units=tuple(units),
        tolerances=np.array(tolerances),
        campaign=campaign,
        assumed=assumed_moments(arm) if states_no_mass(arm) else None,
    )
    lacks = list(built.lacks(campaign.block()))
    if lacks:
        raise ValueError(
            "the campaign does not tell what effects of the arm need; add the columns "
            "or take the effects out of the arm file:\n" + "\n".join(lacks)
        )
    return model


def _coordinate_names(correction: Correction) -> tuple[str, ...]:
    """Name the directions in which values move."""
    if not EFFECT_KINDS[correction.kind].is_about_axis:
        return correction.parameters
    keys = dict.fromkeys(name.partition(".")[0] for name in correction.parameters)
    along = "axial" in correction.variety
    return tuple(f"{key}.{c}" for key in keys for c in ("u" if along else "vw"))
