"""The part's system beside the arm's: part = scale * rotation * arm + translation."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.protocol.messages import AlignArgs


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Where the part is.

    Attributes:
        name: what it is called.
        rotation: (3, 3). translation_mm: (3,).
    """

    name: str
    rotation: Floats
    translation_mm: Floats
    scale: float

    def transform_mm(self, xyz_mm: Floats) -> Floats:
        """Places (n, 3) of the arm's system in that of the part."""
        turned: Floats = xyz_mm @ self.rotation.T
        return self.scale * turned + self.translation_mm


def requested_alignment(args: AlignArgs) -> Alignment | None:
    """The alignment that a command sets; None if it clears it."""
    if args.action == "clear":
        return None
    return Alignment(
        args.name or "",
        np.array(args.rotation, dtype=np.float64),
        np.array(args.translation_mm, dtype=np.float64),
        args.scale,
    )


class ActiveAlignment:
    """The alignment in use, which everything that is published looks up.

    Attributes:
        alignment: None where there is none; replaced whole, between two samples.
    """

    def __init__(self) -> None:
        self.alignment: Alignment | None = None

    def part_mm(self, xyz_mm: Floats) -> tuple[float, float, float] | None:
        """One place (3,) in the part's system; None without an alignment."""
        if self.alignment is None:
            return None
        x, y, z = self.alignment.transform_mm(xyz_mm[np.newaxis])[0].tolist()
        return x, y, z
