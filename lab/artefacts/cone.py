"""A cone: one unknown point, touched again and again (the paper's case c).

w = x - c
"""

from typing import Any, Literal

import numpy as np

from traverse.arrays import Floats
from traverse.lab.artefacts.artefact import Artefact, Equations, Touches

# A seat known to a metre only is useless.
PLACE_SCALE_MM = 1000.0


class Cone(Artefact):
    """A conical seat that centres the ball."""

    rows_per_pose = 3
    kind: Literal["cone"]

    def unknown_scales(self, touches: Touches) -> Floats:
        return np.full(3, PLACE_SCALE_MM)

    def start(self, centres_mm: Floats, touches: Touches) -> Floats:
        """The median point, which a few blunders do not move far."""
        point: Floats = np.median(centres_mm, axis=0)
        return point

    def place(self, state: Floats) -> dict[str, Any]:
        return {"point_mm": state.tolist()}

    def equations(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> Equations:
        """Set up w = x - c."""
        shape = (len(centres_mm), 3, 3)
        return Equations(
            centres_mm - state,
            np.broadcast_to(np.eye(3), shape),
            np.broadcast_to(-np.eye(3), shape),
        )
