"""An alignment as computed: what words, page and file are made of."""

from dataclasses import dataclass, field
from typing import Any

from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import Helmert
from traverse.kinematics.helmert.volume import Ball, Volume, VolumeError, volume_error
from traverse.lab.alignment.statistics import GlobalTest


@dataclass(frozen=True, slots=True, eq=False)
class AlignmentWarning:
    """Something that has to be known before the alignment is used.

    Attributes:
        code: For programs.
        text: For people.
        direction: In the system that it leads to, (3,); None where there is none.
    """

    code: str
    text: str
    direction: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PointResult:
    """A common point, or a touch of a feature.

    Attributes:
        name: As labelled.
        measured_mm: In the arm's system, (3,).
        nominal_mm: In the system that it leads to, (3,); None of touches on features.
        residual_mm: Nominal less transformed, (3,).
        touches: How many it is the mean of.
        spread_mm: Of these.
        redundancy: Of each coordinate, (3,).
        detectable_mm: Least error that is found, in the best and in the worst
            direction; None where it cannot be found, however large.
        worst_direction: Of the error that is found worst, (3,).
        hidden_mm: What an error that is just not found does to the volume, at the
            worst; None where there is no limit to it.
        hidden_ratio: The same per mm of an error in the worst direction.
        p_value: Of its residuals; None where nothing is seen of them.
    """

    name: str
    measured_mm: Floats
    nominal_mm: Floats | None
    residual_mm: Floats
    touches: int
    spread_mm: float | None
    redundancy: Floats
    detectable_mm: tuple[float | None, float | None]
    worst_direction: Floats
    hidden_mm: float | None
    hidden_ratio: float
    p_value: float | None


@dataclass(frozen=True, slots=True, eq=False)
class AlignmentResult:
    """An alignment, and what it is worth.

    Attributes:
        method: `best-fit`, `3-2-1` or `leapfrog`.
        transformation: From the arm's system.
        centre_mm: About which the covariance is told, (3,).
        covariance: Of xi, (p, p); None where nothing tells the errors.
        is_stated: Whether errors are stated; else they are estimated from residuals.
        points: In their order.
        test: Of sigma0; None without redundancy.
        volume: Where it is used, in the system it leads to.
        volume_source: Where the volume comes from.
        index: Of the points' disposition for that volume.
        flags: What has to be known.
        remarks: What else is to be said.
    """

    method: str
    transformation: Helmert
    centre_mm: Floats
    covariance: Floats | None
    is_stated: bool
    points: tuple[PointResult, ...]
    test: GlobalTest | None
    volume: Volume
    volume_source: str
    index: VolumeError
    flags: tuple[AlignmentWarning, ...]
    remarks: tuple[str, ...]
    features: tuple[dict[str, Any], ...] = field(default=())

    @property
    def predicted(self) -> VolumeError | None:
        """Errors of position in the volume; None where nothing tells the errors."""
        if self.covariance is None:
            return None
        return volume_error(self.volume, self.centre_mm, self.covariance)

    @property
    def is_good(self) -> bool:
        """Whether no test failed."""
        return self.test is None or self.test.passed is not False


def volume_values(volume: Volume, source: str) -> dict[str, Any]:
    """Write a volume as in alignment.json."""
    if isinstance(volume, Ball):
        shape = {"centre_mm": volume.mean_mm.tolist(), "radius_mm": volume.radius_mm}
        return {"kind": "ball", **shape, "source": source}
    corners = {"min_mm": volume.low_mm.tolist(), "max_mm": volume.high_mm.tolist()}
    return {"kind": "box", **corners, "source": source}
