"""Seats: a cone, or several at known distances: a bar, printed sockets, drilled holes.

A cone is one unknown point, touched again and again (the paper's case c): w = x - c.

State of several: the points c_i that seat the ball's centre, at the reference
temperature. With growth g they move away from their middle m,
c_i(g) = c_i + g (c_i - m), and

    w = x - c_i(g)
    certificate: |c_j - c_i| = D_ij
"""

from collections.abc import Iterator
from itertools import chain
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from traverse.arrays import Floats
from traverse.lab.artefacts.artefact import (
    PLACE_SCALE_MM,
    Artefact,
    Certificate,
    Equations,
    ExpandingArtefact,
    Length,
    Touches,
    certificate_of,
)
from traverse.strict_toml.reader import StrictModel


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


class SeatDistance(StrictModel):
    """A known distance of two seats."""

    between: tuple[str, str]
    distance_mm: float = Field(gt=0.0)
    distance_std_mm: float | None = Field(default=None, gt=0.0)


class Seats(ExpandingArtefact):
    """Two or more seats; state: their points."""

    rows_per_pose = 3
    kind: Literal["seats"]
    distance_mm: float | None = Field(default=None, gt=0.0)
    distance_std_mm: float | None = Field(default=None, gt=0.0)
    distances: tuple[SeatDistance, ...] = ()

    @model_validator(mode="after")
    def _some_distance(self) -> Self:
        if (self.distance_mm is None) == (not self.distances):
            raise ValueError(
                "needs distance_mm, of two seats that are called 1 and 2, or a list of "
                "distances between named ones; one of both"
            )
        for distance in self.distances:
            if distance.between[0] == distance.between[1]:
                raise ValueError(f"{distance.between[0]!r} has a distance to itself")
        pairs = [frozenset(distance.between) for distance in self.distances]
        if len(set(pairs)) < len(pairs):
            raise ValueError("has two distances between the same seats; keep one")
        return self

    @property
    def known(self) -> tuple[SeatDistance, ...]:
        """The distances, however they are written."""
        if self.distance_mm is None:
            return self.distances
        # Checked already; and one that was left out has an infinite deviation.
        pair = SeatDistance.model_construct(
            between=("1", "2"),
            distance_mm=self.distance_mm,
            distance_std_mm=self.distance_std_mm,
        )
        return (pair,)

    @property
    def features(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(chain.from_iterable(o.between for o in self.known)))

    def fixes_scale(self, touches: Touches) -> bool:
        touched = set(np.unique(touches.features).tolist())
        return any(
            touched >= {first, second} and distance.distance_std_mm != float("inf")
            for distance, first, second in self._pairs()
        )

    @property
    def certified_lengths(self) -> dict[str, float]:
        return {
            self._name(distance): distance.distance_mm
            for distance in self.known
            if distance.distance_std_mm != float("inf")
        }

    def without_certificate(self, name: str) -> Artefact:
        left_out = {"distance_std_mm": float("inf")}
        if self.distance_mm is not None:
            return self.model_copy(update=left_out)
        distances = tuple(
            distance.model_copy(update=left_out)
            if self._name(distance) == name
            else distance
            for distance in self.distances
        )
        return self.model_copy(update={"distances": distances})

    def _name(self, distance: SeatDistance) -> str:
        return ("-".join(distance.between) if self.distances else "distance") + "_mm"

    def unknown_scales(self, touches: Touches) -> Floats:
        return np.full(3 * len(self.features), PLACE_SCALE_MM)

    def start(self, centres_mm: Floats, touches: Touches) -> Floats:
        """Take median points; a seat that was not touched is placed near them."""
        n_seats = len(self.features)
        places_mm = np.tile(np.median(centres_mm, axis=0), (n_seats, 1))
        places_mm[:, 0] += np.arange(n_seats) * self.known[0].distance_mm
        for index in np.unique(touches.features):
            mine = touches.features == index
            places_mm[index] = np.median(centres_mm[mine], axis=0)
        return places_mm.ravel()

    def equations(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> Equations:
        """Set up w = x - c_i - g (c_i - m)."""
        places_mm = state.reshape(-1, 3)
        n_poses, n_seats = len(centres_mm), len(places_mm)
        growths, mine = touches.growths, touches.features
        from_middle_mm = places_mm - places_mm.mean(axis=0)
        grown_mm = places_mm[mine] + growths[:, np.newaxis] * from_middle_mm[mine]
        factors = np.repeat(growths[:, np.newaxis] / n_seats, n_seats, axis=1)
        factors[np.arange(n_poses), mine] -= 1.0 + growths
        by_unknowns = np.einsum("ps,ij->pisj", factors, np.eye(3))
        return Equations(
            centres_mm - grown_mm,
            np.broadcast_to(np.eye(3), (n_poses, 3, 3)),
            by_unknowns.reshape(n_poses, 3, -1),
        )

    def certificate(self, state: Floats, touches: Touches) -> Certificate:
        return certificate_of(
            self.lengths(state),
            [distance.distance_mm for distance in self.known],
            [distance.distance_std_mm for distance in self.known],
        )

    def lengths(self, state: Floats) -> tuple[Length, ...]:
        """The known distances; between named seats `A-B_mm`."""
        places_mm = state.reshape(-1, 3)
        lengths = []
        for row, (distance, first, second) in enumerate(self._pairs()):
            along_mm = places_mm[second] - places_mm[first]
            distance_mm = float(np.linalg.norm(along_mm))
            by_places = np.zeros_like(places_mm)
            by_places[second] = along_mm / max(distance_mm, 1e-9)
            by_places[first] = -by_places[second]
            lengths.append(
                Length(self._name(distance), distance_mm, by_places.ravel(), row)
            )
        return tuple(lengths)

    def place(self, state: Floats) -> dict[str, Any]:
        places_mm = state.reshape(-1, 3).tolist()
        return {"points_mm": dict(zip(self.features, places_mm, strict=True))}

    def _pairs(self) -> Iterator[tuple[SeatDistance, int, int]]:
        """Iterate over the known distances with the indices of their seats."""
        index = {name: at for at, name in enumerate(self.features)}
        for distance in self.known:
            yield distance, index[distance.between[0]], index[distance.between[1]]
