"""Base class of artefacts: conditions on the ball centres that touched them.

An artefact is a table of the campaign file that knows its own condition equations
w(x, z) = 0 between a ball centre x and the artefact's own unknowns z (where it
stands, how large it is), their derivatives, starting values for z, and what its
certificate adds. `state` is z as an array; a step of z may have fewer components
than the state (a unit vector turns in two directions only).
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import Field, field_validator

from traverse.arrays import Booleans, Floats, Integers
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.artefacts.materials import MATERIALS, Expansion, MaterialName
from traverse.strict_toml.reader import StrictModel

# Standard deviation of a certified length without a stated uncertainty: a
# nanometre, which is as good as exact and still an ordinary observation.
EXACT_MM = 1e-6
REFERENCE_TEMPERATURE_C = 20.0
# A place, a height or a radius that is known to a metre only is useless.
PLACE_SCALE_MM = 1000.0


@dataclass(frozen=True, slots=True, eq=False)
class Touches:
    """The poses that touched one artefact.

    Attributes:
        features: Index of the touched feature in the artefact's list, (n_poses,).
        growths: expansion_per_c (T - T_ref) of the artefact, (n_poses,).
        directions: From the ball towards the material, NaN where unknown,
            (n_poses, 3).
        radius_mm: Of the probe's ball.
        feature_names: The artefact's features, in the order of the indices.
        lengths_mm: As read at each pose, where the artefact reads lengths, (n_poses,).
        orientations: Unit quaternions of the instrument's probe in the artefact's frame
            as measured, NaN where none was, (n_poses, 4); None: none at all.
    """

    features: Integers
    growths: Floats
    directions: Floats
    radius_mm: float
    feature_names: tuple[str, ...]
    lengths_mm: Floats | None = None
    orientations: Floats | None = None

    @property
    def oriented(self) -> Booleans:
        """Which poses have a measured orientation, (n_poses,)."""
        if self.orientations is None:
            return np.zeros(len(self.features), dtype=np.bool_)
        return np.isfinite(self.orientations[:, 0])

    @property
    def known_lengths_mm(self) -> Floats:
        """The lengths as read, of an artefact that reads them."""
        if self.lengths_mm is None:
            raise ValueError("touches of an artefact that reads lengths have none")
        return self.lengths_mm

    def part(self, rows: slice | Integers) -> "Touches":
        return Touches(
            self.features[rows],
            self.growths[rows],
            self.directions[rows],
            self.radius_mm,
            self.feature_names,
            None if self.lengths_mm is None else self.lengths_mm[rows],
            None if self.orientations is None else self.orientations[rows],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Condition equations of some poses, n_rows (1 or 3) each.

    Attributes:
        misclosures_mm: w, (n_poses, n_rows).
        by_centre: dw/dx, (n_poses, n_rows, 3).
        by_unknowns: dw/dz, mm per unit, (n_poses, n_rows, n_unknowns).
    """

    misclosures_mm: Floats
    by_centre: Floats
    by_unknowns: Floats

    @classmethod
    def of_surface(
        cls, misclosures_mm: Floats, by_centre: Floats, by_unknowns: Floats
    ) -> Self:
        """Take one condition a pose: (n_poses,), (n_poses, 3), (n_poses, n_unknowns).

        By the centre it may be the same at all poses, (3,).
        """
        units = np.broadcast_to(by_centre, (len(misclosures_mm), 3))
        return cls(
            misclosures_mm[:, np.newaxis],
            units[:, np.newaxis],
            by_unknowns[:, np.newaxis],
        )


@dataclass(frozen=True, slots=True, eq=False)
class OrientationEquations:
    """Condition equations of the orientations of some poses, three each.

    Attributes:
        misclosures_rad: The small rotation vector from what was measured to the model,
            in the arm's frame, (n_poses, 3).
        by_turn: By a small turn of the last body, (n_poses, 3, 3).
        by_unknowns: Per unit, (n_poses, 3, n_unknowns).
    """

    misclosures_rad: Floats
    by_turn: Floats
    by_unknowns: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """Observations of the artefact's own unknowns.

    Attributes:
        misclosures_mm: Unknowns less certified values, (n_values,).
        by_unknowns: Derivatives, (n_values, n_unknowns).
        std_mm: Of the certified values, (n_values,).
    """

    misclosures_mm: Floats
    by_unknowns: Floats
    std_mm: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Length:
    """A length of the artefact as estimated.

    Attributes:
        name: For example `distance_mm`.
        value_mm: Of the state.
        by_unknowns: Derivatives, (n_unknowns,).
        certificate_row: Which value of the certificate is about it, or None.
    """

    name: str
    value_mm: float
    by_unknowns: Floats
    certificate_row: int | None


def certificate_of(
    lengths: Sequence[Length],
    certified_mm: Sequence[float],
    std_mm: Sequence[float | None],
) -> Certificate:
    """Compare lengths with certified ones; without a deviation these are exact."""
    pairs = zip(lengths, certified_mm, strict=True)
    return Certificate(
        np.array([length.value_mm - known_mm for length, known_mm in pairs]),
        np.array([length.by_unknowns for length in lengths]),
        np.array([std or EXACT_MM for std in std_mm]),
    )


class Artefact(StrictModel):
    """A table `[[artefacts]]`; a child a kind.

    Attributes:
        rows_per_pose: Conditions per pose: 3 for a known point, 1 for a surface.
        reads_lengths: Whether each of its poses has a length of its own.
        has_orientations: Whether orientations may be measured in its frame.
        id: What poses call it.
    """

    rows_per_pose: ClassVar[int] = 1
    reads_lengths: ClassVar[bool] = False
    has_orientations: ClassVar[bool] = False

    id: str = Field(min_length=1)
    kind: str
    serial_number: str | None = None
    calibration_date: date | None = None
    certificate_number: str | None = None
    calibrated_by: str | None = None
    valid_until: date | None = None

    @field_validator("id")
    @classmethod
    def _printable_id(cls, text: str) -> str:
        if text != text.strip() or not text.isprintable():
            raise ValueError(f"{text!r} has spaces around it or unprintable characters")
        return text

    @property
    def features(self) -> tuple[str, ...]:
        """The features that may be touched; none: the column is not looked at."""
        return ()

    def reduced(self, touched: Sequence[str]) -> Self:
        """Leave out features that were not touched, where that is possible.

        Args:
            touched: Those to keep, in the order of `features`.
        """
        return self

    def fixes_scale(self, touches: Touches) -> bool:
        """Return whether these touches determine the scale of the arm."""
        return False

    def measured_orientations(self, state: Floats, touches: Touches) -> Floats:
        """Turn measured orientations into the arm's frame, (4, n_poses)."""
        raise NotImplementedError(self.kind)

    def orientation_equations(
        self, state: Floats, turns: Floats, touches: Touches
    ) -> OrientationEquations:
        """Set up the conditions of orientations by the model, (4, n_poses)."""
        raise NotImplementedError(self.kind)

    @property
    def fixes_datum(self) -> bool:
        """Whether its place in the arm's own system is known."""
        return False

    @property
    def expansion(self) -> tuple[float, float]:
        """Expansion per degree Celsius, and the temperature of the certificate."""
        return 0.0, REFERENCE_TEMPERATURE_C

    @property
    def stated_expansion(self) -> Expansion:
        """What is stated of the expansion of its certified lengths, if it has any."""
        return Expansion(None, None)

    def certificate(self, state: Floats, touches: Touches) -> Certificate:
        """Compare the unknowns with the certificate; by default there is none."""
        n_unknowns = len(self.unknown_scales(touches))
        return Certificate(np.empty(0), np.empty((0, n_unknowns)), np.empty(0))

    def lengths(self, state: Floats) -> tuple[Length, ...]:
        """Return the lengths to report; by default there are none."""
        return ()

    def transferred(self, state: Floats, touches: Touches) -> Floats:
        """Take a state that was found with other touches."""
        return state

    @abstractmethod
    def place(self, state: Floats) -> dict[str, Any]:
        """Its place in the arm's system, as plain values by the keys of its kind."""

    @property
    def certified_lengths(self) -> dict[str, float]:
        """Lengths of which each may be wrong by itself [mm]; by default none."""
        return {}

    @property
    def certified_radii(self) -> tuple[str, ...]:
        """Certified lengths that a shift of contacts changes."""
        shifted = self.with_contact_shift(1.0).certified_lengths
        lengths = self.certified_lengths.items()
        return tuple(name for name, value_mm in lengths if shifted[name] != value_mm)

    @property
    def certifies_distance(self) -> bool:
        """Whether a length is certified that no shift of contacts changes."""
        return len(self.certified_radii) < len(self.certified_lengths)

    def without_certificate(self, name: str) -> "Artefact":
        """Leave a certified length out: it starts there, and is no observation."""
        key = name.removesuffix("_mm") + "_std_mm"
        return self.model_copy(update={key: float("inf")})

    def with_contact_shift(self, shift_mm: float) -> "Artefact":
        """Certify what the probe would measure if its radius were larger by a shift.

        Touching from outside, a sphere looks larger; by default nothing changes.
        """
        return self

    def moved(self, state: Floats, step: Floats) -> Floats:
        """Apply a step of the unknowns, (n_unknowns,)."""
        return state + step

    @abstractmethod
    def unknown_scales(self, touches: Touches) -> Floats:
        """Return a standard deviation of each unknown that counts as undetermined."""

    @abstractmethod
    def start(self, centres_mm: Floats, touches: Touches) -> Floats:
        """Find a state from centres (n_poses, 3) in closed form."""

    def mirror_images(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> tuple[Floats, ...]:
        """Return states that few touches fit nearly as well; by default there are none.

        From centres (n_poses, 3) of which the state is a fit.
        """
        return ()

    @abstractmethod
    def equations(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> Equations:
        """Set up the condition equations of centres (n_poses, 3)."""


class ExpandingArtefact(Artefact):
    """An artefact with certified lengths, which grow with the temperature.

    Attributes:
        material: Says how much it expands where `expansion_per_c` does not.
        expansion_per_c: From what shrinks slightly, as carbon fibre, to plastics.
        expansion_std_per_c: Standard uncertainty of `expansion_per_c`.
    """

    material: MaterialName | None = None
    expansion_per_c: float | None = Field(default=None, ge=-5e-6, le=3e-4)
    expansion_std_per_c: float | None = Field(default=None, ge=0.0)
    reference_temperature_c: float = REFERENCE_TEMPERATURE_C

    @property
    def expansion(self) -> tuple[float, float]:
        per_c = self.stated_expansion.per_c
        return per_c or 0.0, self.reference_temperature_c

    @property
    def stated_expansion(self) -> Expansion:
        if self.expansion_per_c is None and self.material is not None:
            return MATERIALS[self.material]
        return Expansion(self.expansion_per_c, self.expansion_std_per_c)


_STEPS = 15
_LARGEST_STEP_RAD = 0.5
# A hundredth of the reach keeps steps bounded where the arm is stretched.
_STIFFNESS_MM2 = 100.0
_REACHED_MM = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class TouchingPostures:
    """Where the joints were.

    Attributes:
        angles_rad: (n, n_joints).
        is_touching: Whether the ball touches, within the joints' limits, (n,).
    """

    angles_rad: Floats
    equations: Equations
    is_touching: Booleans


def postures_touching(
    artefact: Artefact,
    unknowns: Floats,
    touches: Touches,
    geometry: Geometry,
    tries_rad: Floats,
    *,
    limits_rad: Floats,
) -> TouchingPostures:
    """Turn the joints until the ball touches the artefact, as far as possible.

    From tries, (n, n_joints), one for each of n touches. Limits are the smallest and
    the largest readings, (2, n_joints).
    """
    angles_rad = tries_rad
    for _ in range(_STEPS):
        derivatives = probe_derivatives(geometry, angles_rad)
        equations = artefact.equations(unknowns, derivatives.centres_mm, touches)
        slopes = equations.by_centre @ derivatives.by_angles
        square = slopes @ slopes.swapaxes(1, 2)
        square = square + _STIFFNESS_MM2 * np.eye(square.shape[1])
        solved = np.linalg.solve(square, equations.misclosures_mm[:, :, np.newaxis])
        step = -(slopes.swapaxes(1, 2) @ solved)[:, :, 0]
        angles_rad = angles_rad + np.clip(step, -_LARGEST_STEP_RAD, _LARGEST_STEP_RAD)
    centres_mm = probe_centre(geometry, angles_rad)
    equations = artefact.equations(unknowns, centres_mm, touches)
    misses_mm = np.max(np.abs(equations.misclosures_mm), axis=1)
    least_rad, largest_rad = limits_rad
    within = np.all((angles_rad >= least_rad) & (angles_rad <= largest_rad), axis=1)
    return TouchingPostures(angles_rad, equations, within & (misses_mm < _REACHED_MM))
