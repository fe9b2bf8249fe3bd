"""What all artefacts have in common."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    SerializeAsAny,
    field_validator,
)

from traverse.arrays import Floats, Indices
from traverse.simulator.campaigns.artefacts.placement import Placement
from traverse.strict_toml.reader import StrictModel

Table = dict[str, Any]  # an artefact in campaign.toml or truth.json

REFERENCE_C = 20.0  # where the standards have their lengths
KINDS: dict[
    str, type["Artefact"]
] = {}  # filled by traverse.simulator.campaigns.artefacts


@dataclass(frozen=True, slots=True)
class Contacts:
    """Where the ball's centre is when it touches.

    Attributes:
        centres_mm: (n, 3)
        towards: (n, 3) unit vectors from the ball towards the material; NaN where the
            ball is held by a seat and there is no such direction.
    """

    centres_mm: Floats
    towards: Floats


class Artefact(StrictModel):
    """An artefact; every kind is a class of its own in a file of its own.

    Attributes:
        kind: Its name in campaign files.
        id: Unique in the campaign.
        n_poses: How often it is touched.
        contact_mm: Noise of its contacts; absent: that of the campaign.
    """

    kind: str
    id: str = Field(pattern=r"^[A-Za-z0-9_.+-]+$", min_length=1)
    n_poses: int = Field(ge=1)
    contact_mm: float | None = Field(default=None, ge=0.0)

    @classmethod
    def variant(cls, table: object) -> "type[Artefact]":
        """Select the class of a table by its kind."""
        kind = table.get("kind") if isinstance(table, Mapping) else None
        return KINDS.get(str(kind), UnknownArtefact)

    @property
    def features(self) -> tuple[str, ...]:
        """Names of its parts."""
        return ("",)

    @property
    def is_fixed(self) -> bool:
        """There is no other spot to touch: every feature must be reached."""
        return False

    @property
    def thermal_growth_per_c(self) -> float:
        """By how much its lengths grow."""
        return 0.0

    def size_problem(self, ball_mm: float) -> str | None:
        """State why a ball of this radius does not fit."""
        return None

    def contacts(
        self,
        rng: np.random.Generator,
        features: Indices,
        ball_mm: float,
        growths: Floats,
    ) -> Contacts:
        """Draw contacts in the artefact's own coordinates.

        Args:
            rng: Draws where it is touched.
            features: (n,) which part is touched, index into `features`.
            ball_mm: Radius of the ball.
            growths: (n,) lengths at the time of the contact over those at 20 C.
        """
        raise NotImplementedError(self.kind)

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        """Its statement in a campaign; the errors of standards are drawn."""
        raise NotImplementedError(self.kind)

    def true_table(self, placement: Placement) -> Table:
        """What is true of it at 20 C, in the arm's system."""
        raise NotImplementedError(self.kind)


class UnknownArtefact(Artefact):
    """What is of no known kind: refused for that alone, not for its other keys."""

    model_config = ConfigDict(extra="ignore")

    @field_validator("kind")
    @classmethod
    def _refuse(cls, kind: str) -> str:
        known = ", ".join(sorted(KINDS))
        raise ValueError(f"unknown kind of artefact '{kind}'; known: {known}")


def artefact_from_table(table: object) -> Artefact:
    """Make an artefact of the class of its kind."""
    if isinstance(table, Artefact):
        return table
    return Artefact.variant(table).model_validate(table)


AnyArtefact = Annotated[SerializeAsAny[Artefact], BeforeValidator(artefact_from_table)]


def stated_length(
    rng: np.random.Generator, key: str, true_mm: float, std_mm: float
) -> Table:
    """The key of a length as its certificate has it, with its uncertainty if any."""
    table: Table = {f"{key}_mm": true_mm + std_mm * float(rng.standard_normal())}
    if std_mm > 0.0:
        table[f"{key}_std_mm"] = std_mm
    return table


def stated_expansion(expansion_per_c: float) -> Table:
    """The key of the expansion, where there is any."""
    return {"expansion_per_c": expansion_per_c} if expansion_per_c else {}


def no_directions(n_contacts: int) -> Floats:
    """Directions (n, 3) that do not exist."""
    return np.full((n_contacts, 3), np.nan)
