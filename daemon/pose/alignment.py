"""Alignment: part = scale * rotation * arm + translation."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.protocol.messages import AlignArgs


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Coordinate system of the part.

    Attributes:
        rotation: (3, 3). translation_mm: (3,).
    """

    name: str
    rotation: Floats
    translation_mm: Floats
    scale: float

    def transform_mm(self, xyz_mm: Floats) -> Floats:
        """Transform arm coordinates (n, 3) to part coordinates."""
        turned: Floats = xyz_mm @ self.rotation.T
        return self.scale * turned + self.translation_mm


def requested_alignment(args: AlignArgs) -> Alignment | None:
    """Return the alignment of a command; None if it clears it."""
    if args.action == "clear":
        return None
    return Alignment(
        args.name or "",
        np.array(args.rotation, dtype=np.float64),
        np.array(args.translation_mm, dtype=np.float64),
        args.scale,
    )


class ActiveAlignment:
    """The alignment in use.

    Attributes:
        alignment: None if there is none; replaced whole, between two samples.
    """

    def __init__(self) -> None:
        self.alignment: Alignment | None = None

    def part_mm(self, xyz_mm: Floats) -> tuple[float, float, float] | None:
        """Transform one position (3,); None without an alignment."""
        if self.alignment is None:
            return None
        x, y, z = self.alignment.transform_mm(xyz_mm[np.newaxis])[0].tolist()
        return x, y, z
