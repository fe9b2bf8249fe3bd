"""Cone: one unknown point; the ball is seated in it again and again."""

from typing import Literal

import numpy as np

from traverse.arrays import Floats, Indices
from traverse.simulator.campaigns.artefacts.artefact import (
    Artefact,
    Contacts,
    Table,
    no_directions,
)
from traverse.simulator.campaigns.artefacts.placement import Placement


class Cone(Artefact):
    """A seat for the ball."""

    kind: Literal["cone"] = "cone"

    @property
    def is_fixed(self) -> bool:
        """A seat is a seat."""
        return True

    def contacts(
        self,
        rng: np.random.Generator,
        features: Indices,
        ball_mm: float,
        growths: Floats,
    ) -> Contacts:
        """The seat, as often as requested."""
        return Contacts(np.zeros((len(features), 3)), no_directions(len(features)))

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        """Nothing is known of it."""
        return {}

    def true_table(self, placement: Placement) -> Table:
        """Where the seated ball's centre is."""
        return {"point_mm": placement.position_mm.tolist()}
