"""Base class of artefacts, and their places."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    SerializeAsAny,
)

from traverse.arrays import Floats, Indices
from traverse.simulator.kind_table import KindTable


@dataclass(frozen=True, slots=True)
class Placement:
    """A rigid motion.

    Attributes:
        rotation: (3, 3) its columns are the artefact's axes in the arm's system.
        position_mm: (3,) the artefact's origin in the arm's system.
    """

    rotation: Floats
    position_mm: Floats

    def points_mm(self, own_mm: Floats) -> Floats:
        """Transform points (n, 3) of the artefact to the arm's system."""
        return own_mm @ self.rotation.T + self.position_mm

    def directions(self, directions: Floats) -> Floats:
        """Transform directions (n, 3) of the artefact to the arm's system."""
        return directions @ self.rotation.T


def drawn_rotation(rng: np.random.Generator) -> Floats:
    """Draw a rotation (3, 3) evenly: the axes of a random frame, made right-handed."""
    frame, triangle = np.linalg.qr(rng.standard_normal((3, 3)))
    frame = frame * np.sign(np.diag(triangle))
    if np.linalg.det(frame) < 0.0:
        frame[:, 2] = -frame[:, 2]
    rotation: Floats = frame
    return rotation


def drawn_directions(
    rng: np.random.Generator, n_directions: int, opening_rad: float
) -> Floats:
    """Draw unit vectors (n, 3) evenly over a cap about the third axis."""
    heights = rng.uniform(np.cos(opening_rad), 1.0, n_directions)
    around = rng.uniform(-np.pi, np.pi, n_directions)
    radii = np.sqrt(np.maximum(0.0, 1.0 - heights**2))
    return np.stack([radii * np.cos(around), radii * np.sin(around), heights], axis=1)


Table = dict[str, Any]  # an artefact in campaign.toml or truth.json

REFERENCE_C = 20.0  # where the standards have their lengths


@dataclass(frozen=True, slots=True)
class Contacts:
    """Ball centres in contact.

    Attributes:
        centres_mm: (n, 3)
        towards: (n, 3) unit vectors from the ball towards the material; NaN in a
            seat.
    """

    centres_mm: Floats
    towards: Floats


@dataclass(frozen=True, slots=True)
class Touches:
    """Requested contacts.

    Attributes:
        features: (n,) index into the artefact's `features`.
        ball_mm: radius of the ball.
        growths: (n,) lengths at the time of contact over those at 20 C.
    """

    rng: np.random.Generator
    features: Indices
    ball_mm: float
    growths: Floats

    @property
    def n(self) -> int:
        return len(self.features)


class Artefact(KindTable):
    """An artefact; every kind is a class of its own.

    Attributes:
        kind: name in campaign files.
        id: unique in the campaign.
        contact_mm: noise of its contacts; absent: the campaign's.
    """

    FAMILY = "artefact"
    KINDS: ClassVar[dict[str, type["Artefact"]]] = {}  # filled by the package
    IS_FIXED: ClassVar[bool] = False  # no other spot to touch: all must be reached

    id: str = Field(pattern=r"^[A-Za-z0-9_.+-]+$", min_length=1)
    n_poses: int = Field(ge=1)
    contact_mm: float | None = Field(default=None, ge=0.0)

    @property
    def features(self) -> tuple[str, ...]:
        return ("",)

    @property
    def thermal_growth_per_c(self) -> float:
        return 0.0

    def size_problem(self, ball_mm: float) -> str | None:
        """State why a ball of this radius does not fit."""
        return None

    def contacts(self, touches: Touches) -> Contacts:
        raise NotImplementedError(self.kind)

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        """Draw errors and return the statement in a campaign; here none."""
        return {}

    def true_table(self, placement: Placement) -> Table:
        """Return its true values at 20 C, in the arm's system."""
        raise NotImplementedError(self.kind)


AnyArtefact = Annotated[SerializeAsAny[Artefact], BeforeValidator(Artefact.from_table)]


class Standard(Artefact):
    """An artefact with a certificate."""

    expansion_per_c: float = 0.0

    @property
    def thermal_growth_per_c(self) -> float:
        return self.expansion_per_c

    @property
    def stated_expansion(self) -> Table:
        stated = {"expansion_per_c": self.expansion_per_c}
        return stated if self.expansion_per_c else {}


def stated_length(
    rng: np.random.Generator, key: str, true_mm: float, std_mm: float
) -> Table:
    table: Table = {f"{key}_mm": true_mm + std_mm * float(rng.standard_normal())}
    if std_mm > 0.0:
        table[f"{key}_std_mm"] = std_mm
    return table


def no_directions(n_contacts: int) -> Floats:
    return np.full((n_contacts, 3), np.nan)
