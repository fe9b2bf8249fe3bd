"""Shape of the common points, which limits the transformation."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from traverse.arrays import Floats
from traverse.plurals import counted

Kind = Literal["none", "one place", "line", "plane", "space"]

# Parts of the longest extent: below the first, rounding decides.
_EXACT = 1e-9
_FLAT = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """Shape of points about their mean.

    Attributes:
        mean_mm: (3,).
        axes: Principal directions as rows, the longest first, (3, 3).
        extents_mm: Root mean square along them, (3,).
    """

    n: int
    mean_mm: Floats
    axes: Floats
    extents_mm: Floats

    @property
    def kind(self) -> Kind:
        """Dimension that they span, also if they do so only nearly."""
        if self.n == 0:
            return "none"
        length_mm = float(self.extents_mm[0])
        if not length_mm > _EXACT * (1.0 + float(np.max(np.abs(self.mean_mm)))):
            return "one place"
        if not self.extents_mm[1] > _EXACT * length_mm:
            return "line"
        return "plane" if self.extents_mm[2] < _FLAT * length_mm else "space"

    @property
    def straightness(self) -> float:
        """Straightness: root mean square distance from a line over that along it."""
        across_mm = float(np.hypot(self.extents_mm[1], self.extents_mm[2]))
        return across_mm / float(self.extents_mm[0])


def shape_of(points_mm: Floats) -> Shape:
    """Compute the shape of points (n, 3)."""
    n = len(points_mm)
    if n == 0:
        return Shape(0, np.zeros(3), np.eye(3), np.zeros(3))
    mean_mm = points_mm.mean(axis=0)
    _, sizes_mm, axes = np.linalg.svd(points_mm - mean_mm, full_matrices=True)
    sizes_mm = np.append(sizes_mm, np.zeros(3 - len(sizes_mm)))
    for row in range(3):
        axes[row] *= np.sign(axes[row, np.argmax(np.abs(axes[row]))])
    return Shape(n, mean_mm, axes, sizes_mm / np.sqrt(n))


def undetermined(shape: Shape) -> str | None:
    """Name the freedom that such points leave; None if there is none."""
    if shape.kind == "none":
        return "no common points: nothing is determined"
    if shape.kind == "one place":
        return (
            f"{_points(shape.n)} in one place: all three rotations are undetermined; "
            "measure at least three points that do not lie on one line"
        )
    if shape.kind == "line":
        return (
            f"{_points(shape.n)} on one line: the rotation about it, about the "
            f"direction {direction_text(shape.axes[0])}, is undetermined; measure at "
            "least one more point, far beside the line"
        )
    return None


def direction_text(direction: Floats) -> str:
    parts = (f"{round(part, 3) + 0.0:.3f}" for part in direction.tolist())
    return f"({', '.join(parts)})"


def _points(n: int) -> str:
    return counted(n, "common point")
