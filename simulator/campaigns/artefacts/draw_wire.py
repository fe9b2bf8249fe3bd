"""A draw wire: the ball is anywhere around its anchor, and the length is read."""

from typing import Literal

import numpy as np
from pydantic import Field

from traverse.simulator.campaigns.artefacts.artefact import (
    Artefact,
    Contacts,
    Placement,
    Table,
    Touches,
    drawn_directions,
    no_directions,
)


class DrawWire(Artefact):
    """A wire whose end is held at the ball's centre.

    Attributes:
        shortest_mm: To which the wire is drawn out, from its anchor to the ball.
        longest_mm: Likewise.
        offset_mm: By which that is longer than what is read.
        known: Whether the campaign states the offset.
        opening_rad: From the wire's middle direction to the last.
    """

    kind: Literal["draw_wire"] = "draw_wire"
    shortest_mm: float = Field(gt=0.0)
    longest_mm: float = Field(gt=0.0)
    offset_mm: float = 0.0
    known: bool = False
    opening_rad: float = Field(default=1.2, gt=0.0, le=float(np.pi))

    def size_problem(self, ball_mm: float) -> str | None:
        """It must be drawn out."""
        if self.longest_mm <= self.shortest_mm:
            return (
                f"longest_mm = {self.longest_mm:g} is not longer than shortest_mm = "
                f"{self.shortest_mm:g}"
            )
        return None

    def contacts(self, touches: Touches) -> Contacts:
        """Places in a cap of a shell around the anchor."""
        outwards = drawn_directions(touches.rng, touches.n, self.opening_rad)
        drawn_mm = touches.rng.uniform(self.shortest_mm, self.longest_mm, touches.n)
        return Contacts(drawn_mm[:, None] * outwards, no_directions(touches.n))

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        """The offset, if it is known."""
        return {"offset_mm": self.offset_mm} if self.known else {}

    def true_table(self, placement: Placement) -> Table:
        """Anchor and offset."""
        return {
            "anchor_mm": placement.position_mm.tolist(),
            "offset_mm": self.offset_mm,
        }
