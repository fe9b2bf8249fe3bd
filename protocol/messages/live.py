"""Live: the latest pose, thinned to a display rate."""

from typing import Annotated, Literal

from pydantic import Field

from traverse.protocol.messages.fields import (
    Angles,
    ArmName,
    Digest,
    Message,
    Name,
    NotNegative,
    TimeNs,
    Vector,
    schema_field,
)
from traverse.protocol.messages.point import Covariance
from traverse.protocol.messages.quality import Quality


class Live(Message):
    """The latest pose, for displays: may be thinned or lost, never for measuring."""

    schema_: Literal["traverse/live/1"] = schema_field("traverse/live/1")
    arm: ArmName
    """Name of the arm."""
    model: Digest
    """Digest of the arm file that the coordinates were computed with."""
    session: Name | None
    """Session that new points belong to; null before the first."""
    time_ns: TimeNs
    """Instant of the sample. [UTC]"""
    xyz_mm: Vector
    """Ball centre in the arm's system."""
    ijk: Vector
    """Unit vector of the shank, from the wrist to the ball, in the arm's system."""
    part_xyz_mm: Vector | None
    """Ball centre in the part's system; null without an alignment."""
    covariance_mm2: Covariance | None
    """Covariance of xyz_mm: xx, xy, xz, yy, yz, zz; null where it is not known."""
    angles_rad: Angles
    """Readings of the joints from the base outwards, uncorrected, unwrapped."""
    skeleton_mm: (
        Annotated[tuple[Vector, ...], Field(max_length=64, fail_fast=True)] | None
    )
    """Origins of the joints from the base outwards, then the ball; null if left out."""
    speed_mm_s: NotNegative | None
    """Speed of the ball; null where one sample is all there is."""
    probe_radius_mm: NotNegative
    """Radius of the ball."""
    inputs: Annotated[tuple[Name, ...], Field(max_length=64)]
    """Active inputs (buttons, switching probe) as "<device id>/<input>"."""
    quality: Quality
    """Whether the point may be trusted."""
