"""Known points: in the arm's own system (case a) or in one of their own (case b).

State: a unit quaternion q, a translation t, a scale s, then the coordinates A of
every point. With growth g

    w = x - t - s (1 + g) R(q) A        frame "own" (s held) and "own_scaled"
    w = x - (1 + g) A                   frame "arm"
    certificate: A as given, where points_std_mm says that they are not exact

A measured orientation O takes vectors of the instrument's probe to the points' frame.
With T the probe's rotation by the arm's model, and the unit quaternion (c, e) with
c >= 0 of

    T (R(q) O)^-1        w = 2 e, up to the third order its rotation vector
"""

from collections.abc import Sequence
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.kinematics.effect_table import Vector
from traverse.kinematics.helmert.transformation import closed_helmert, quaternion_of
from traverse.kinematics.model.quaternion import (
    conjugate,
    multiply,
    rotate,
    rotation_matrix,
)
from traverse.lab.artefacts.artefact import (
    PLACE_SCALE_MM,
    Certificate,
    Equations,
    ExpandingArtefact,
    OrientationEquations,
    Touches,
)

_POINT_SCALE_MM = 100.0
_N_FRAME_UNKNOWNS = {"arm": 0, "own": 6, "own_scaled": 7}


class Points(ExpandingArtefact):
    """A set of points with known coordinates in some system."""

    rows_per_pose = 3
    has_orientations = True
    kind: Literal["points"]
    frame: Literal["arm", "own", "own_scaled"]
    points_mm: dict[str, Vector] | str
    points_std_mm: float | None = Field(default=None, gt=0.0)

    @property
    def features(self) -> tuple[str, ...]:
        return tuple(self.points_mm) if isinstance(self.points_mm, dict) else ()

    def reduced(self, touched: Sequence[str]) -> Self:
        if not isinstance(self.points_mm, dict):
            return self
        kept = {name: self.points_mm[name] for name in touched}
        return self.model_copy(update={"points_mm": kept})

    def fixes_scale(self, touches: Touches) -> bool:
        """Return whether known points determine the scale, which is not estimated."""
        n_points = len(np.unique(touches.features))
        return self.frame == "arm" or (self.frame == "own" and n_points > 1)

    @property
    def fixes_datum(self) -> bool:
        """Known in the arm's system: they are the datum."""
        return self.frame == "arm"

    def unknown_scales(self, touches: Touches) -> Floats:
        """Rotation, translation, scale; coordinates where they are not exact."""
        frame = np.array([1.0] * 3 + [PLACE_SCALE_MM] * 3 + [1.0])
        n_points = len(touches.feature_names) if self.points_std_mm else 0
        return np.concatenate(
            [
                frame[: _N_FRAME_UNKNOWNS[self.frame]],
                np.full(3 * n_points, _POINT_SCALE_MM),
            ]
        )

    def start(self, centres_mm: Floats, touches: Touches) -> Floats:
        """Fit a similarity in closed form; blunders are weighted down."""
        known_mm = self._known_mm(touches)
        frame = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        if self.frame != "arm":
            grown_mm = known_mm[touches.features]
            weights = np.ones(len(centres_mm))
            with_scale = self.frame == "own_scaled" and bool(
                np.any(np.ptp(grown_mm, axis=0))
            )
            for _ in range(10):
                motion = closed_helmert(
                    grown_mm, centres_mm, weights, with_scale=with_scale
                )
                away_mm = np.linalg.norm(
                    centres_mm - motion.places_mm(grown_mm), axis=1
                )
                least_mm = max(3.0 * float(np.median(away_mm)), 1e-9)
                weights = 1.0 / (1.0 + (away_mm / least_mm) ** 2)
            turn, shift_mm = quaternion_of(motion.rotation), motion.translation_mm
            frame = np.array([*turn, *shift_mm, motion.scale])
        return np.concatenate([frame, known_mm.ravel()])

    def equations(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> Equations:
        """Set up w = x - t - s (1 + g) R(q) A."""
        n_poses, n_frame = len(centres_mm), _N_FRAME_UNKNOWNS[self.frame]
        coordinates_mm = state[8:].reshape(-1, 3)[touches.features]
        factors = state[7] * (1.0 + touches.growths)
        turned_mm = rotate(state[:4, np.newaxis], coordinates_mm.T)
        placed_mm = (factors * turned_mm).T
        by_unknowns = np.zeros((n_poses, 3, len(self.unknown_scales(touches))))
        if n_frame:
            # A small turn e before R moves the point by e x placed.
            by_unknowns[:, :, :3] = np.cross(
                placed_mm[:, np.newaxis], np.eye(3)
            ).swapaxes(1, 2)
            by_unknowns[:, :, 3:6] = -np.eye(3)
        if n_frame > 6:
            by_unknowns[:, :, 6] = -placed_mm / state[7]
        if self.points_std_mm:
            columns = rotation_matrix(state[:4])
            rows = np.arange(n_poses)
            for component in range(3):
                by_unknowns[rows, :, n_frame + 3 * touches.features + component] = (
                    -factors[:, np.newaxis] * columns[:, component]
                )
        return Equations(
            centres_mm - state[4:7] - placed_mm,
            np.broadcast_to(np.eye(3), (n_poses, 3, 3)),
            by_unknowns,
        )

    def measured_orientations(self, state: Floats, touches: Touches) -> Floats:
        """R(q) O of poses that have orientations, (4, n_poses)."""
        if touches.orientations is None:
            raise ValueError(f"touches of {self.id!r} have no orientations")
        return multiply(state[:4, np.newaxis], touches.orientations.T)

    def orientation_equations(
        self, state: Floats, turns: Floats, touches: Touches
    ) -> OrientationEquations:
        """Set up w = 2 e of T (R(q) O)^-1 = (c, e), all of poses with orientations.

        A small turn t of the arm changes it by c t + t x e, a small turn f of the frame
        by - c f - e x f.
        """
        measured = self.measured_orientations(state, touches)
        errors = multiply(turns, conjugate(measured))
        errors = np.where(errors[0] < 0.0, -errors, errors)
        cosine, vectors = errors[0][:, np.newaxis, np.newaxis] * np.eye(3), errors[1:].T
        crossed = np.cross(vectors[:, np.newaxis], np.eye(3)).swapaxes(1, 2)
        by_unknowns = np.zeros((len(vectors), 3, len(self.unknown_scales(touches))))
        if _N_FRAME_UNKNOWNS[self.frame]:
            by_unknowns[:, :, :3] = -cosine - crossed
        return OrientationEquations(2.0 * vectors, cosine - crossed, by_unknowns)

    def certificate(self, state: Floats, touches: Touches) -> Certificate:
        if self.points_std_mm is None:
            return super().certificate(state, touches)
        n_frame = _N_FRAME_UNKNOWNS[self.frame]
        deviations_mm = state[8:] - self._known_mm(touches).ravel()
        n_values = len(deviations_mm)
        return Certificate(
            deviations_mm,
            np.hstack([np.zeros((n_values, n_frame)), np.eye(n_values)]),
            np.full(n_values, self.points_std_mm),
        )

    def transferred(self, state: Floats, touches: Touches) -> Floats:
        """Take the frame; the points are those of these touches, as known."""
        return np.concatenate([state[:8], self._known_mm(touches).ravel()])

    def place(self, state: Floats) -> dict[str, Any]:
        """R, t, s of x = t + s R A, with A the known coordinates."""
        return {
            "rotation": rotation_matrix(state[:4]).tolist(),
            "translation_mm": state[4:7].tolist(),
            "scale": float(state[7]),
        }

    def moved(self, state: Floats, step: Floats) -> Floats:
        n_frame = _N_FRAME_UNKNOWNS[self.frame]
        moved = state.copy()
        if n_frame:
            small = np.append(1.0, 0.5 * step[:3])
            moved[:4] = multiply(small / np.linalg.norm(small), state[:4])
            moved[4:7] += step[3:6]
        if n_frame > 6:
            moved[7] += step[6]
        moved[8 : 8 + len(step) - n_frame] += step[n_frame:]
        return moved

    def _known_mm(self, touches: Touches) -> Floats:
        if not isinstance(self.points_mm, dict):
            raise TypeError(f"points of {self.id!r} are still in {self.points_mm!r}")
        return np.array([self.points_mm[name] for name in touches.feature_names])
