"""A draw wire: an encoder reads how far the ball is from where the wire leaves it.

State: the anchor a, and the offset o by which the distance is longer than what is
read. With the length L that is read at a pose

    w = |x - a| - L - o
    certificate: o, where it is known
"""

from typing import Any, Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.lab.artefacts.artefact import (
    PLACE_SCALE_MM,
    Artefact,
    Certificate,
    Equations,
    Length,
    Touches,
    certificate_of,
)
from traverse.lab.artefacts.sphere import FLAT, distances, polished


class DrawWire(Artefact):
    """A wire whose end is held at the ball's centre; state: anchor and offset."""

    reads_lengths = True
    kind: Literal["draw_wire"]
    offset_mm: float | None = None
    offset_std_mm: float | None = Field(default=None, gt=0.0)

    def fixes_scale(self, touches: Touches) -> bool:
        return bool(np.ptp(touches.known_lengths_mm) > 0.0)

    def unknown_scales(self, touches: Touches) -> Floats:
        return np.full(4, PLACE_SCALE_MM)

    def start(self, centres_mm: Floats, touches: Touches) -> Floats:
        """Intersect spheres: algebraically, then a few robust steps.

        |x|^2 - L^2 = 2 x . a + 2 L o - (|a|^2 - o^2) is linear in a, o and the rest.
        """
        middle_mm = centres_mm.mean(axis=0)
        local_mm = centres_mm - middle_mm
        read_mm = touches.known_lengths_mm + (self.offset_mm or 0.0)
        squares = np.einsum("ij,ij->i", local_mm, local_mm) - read_mm**2
        columns = [2.0 * local_mm, -np.ones((len(read_mm), 1))]
        if self.offset_mm is None:
            columns.append(2.0 * read_mm[:, np.newaxis])
        design = np.hstack(columns)
        sizes = np.maximum(np.linalg.norm(design, axis=0), 1e-9)
        solved = np.linalg.lstsq(design / sizes, squares, rcond=FLAT)[0] / sizes
        anchor_mm = solved[:3]
        offset_mm = float(solved[4]) if self.offset_mm is None else 0.0
        anchor_mm, offset_mm = polished(
            local_mm,
            anchor_mm,
            offset_mm,
            is_known=self.offset_mm is not None,
            lengths=read_mm,
        )
        return np.append(middle_mm + anchor_mm, offset_mm + (self.offset_mm or 0.0))

    def equations(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> Equations:
        """Set up w = |x - a| - L - o."""
        away_mm, units = distances(centres_mm, state[:3])
        misclosures_mm = away_mm - touches.known_lengths_mm - state[3]
        by_unknowns = np.column_stack([-units, -np.ones(len(units))])
        return Equations.of_surface(misclosures_mm, units, by_unknowns)

    def certificate(self, state: Floats, touches: Touches) -> Certificate:
        if self.offset_mm is None:
            return super().certificate(state, touches)
        std_mm = self.offset_std_mm
        return certificate_of(self.lengths(state), [self.offset_mm], [std_mm])

    def lengths(self, state: Floats) -> tuple[Length, ...]:
        by_unknowns = np.array([0.0, 0.0, 0.0, 1.0])
        return (Length("offset_mm", float(state[3]), by_unknowns, None),)

    def place(self, state: Floats) -> dict[str, Any]:
        return {"anchor_mm": state[:3].tolist()}
