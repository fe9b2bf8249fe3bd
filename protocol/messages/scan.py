"""Scan: a block of timed points as arrays."""

from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from traverse.arrays import Floats, Integers
from traverse.protocol.messages.array_field import ArrayField
from traverse.protocol.messages.fields import (
    ArmName,
    Count,
    Digest,
    Message,
    Name,
    Positive,
    TimeNs,
    schema_field,
)

ScanMode = Literal["time", "distance", "planes"]
Coordinates = Annotated[Floats, ArrayField("float64", ("n", 3))]
JointAngles = Annotated[Floats, ArrayField("float64", ("n", "joints"))]
JointCounts = Annotated[Integers, ArrayField("int64", ("n", "joints"))]
Offsets = Annotated[Integers, ArrayField("int64", ("n",))]
Covariances = Annotated[Floats, ArrayField("float64", ("n", 6))]
Bits = Annotated[NDArray[np.uint32], ArrayField("uint32", ("n",))]


ARRAYS = (
    *("xyz_mm", "ijk", "angles_rad", "counts", "part_xyz_mm", "covariance_mm2"),
    "quality",
)
"""Fields that have a row for each point, beside dtime_ns."""


class Scan(Message):
    """A block of n points of one scan; point i of it has the number seq + i."""

    schema_: Literal["traverse/scan/1"] = schema_field("traverse/scan/1")
    session: Name
    """Session in which the scan was made."""
    scan: Name
    """Identifier of the scan, unique in the session."""
    seq: Count
    """Number of the first point here. Numbers count from 0 at the scan's start, those
    of dropped points included: a block that does not follow the last one shows a gap.
    """
    arm: ArmName
    """Name of the arm."""
    model: Digest
    """Digest of the arm file that the coordinates were computed with."""
    mode: ScanMode
    """What the points are spaced by."""
    rate_hz: Positive | None
    """Nominal rate of points in mode "time", else null."""
    probe_radius_mm: Annotated[float, Field(ge=0)]
    """Radius of the ball."""
    time_ns: TimeNs
    """Instant from which dtime_ns counts: that of the first point. [UTC]"""
    dtime_ns: Offsets
    """Instants of the points after time_ns; never decreasing."""
    xyz_mm: Coordinates
    """Ball centres in the arm's system."""
    ijk: Coordinates
    """Unit vectors of the shank, from the wrist to the ball."""
    angles_rad: JointAngles
    """Readings of the joints, uncorrected, unwrapped."""
    counts: JointCounts | None
    """Counts of the joints, unwrapped; null where the configuration leaves them out."""
    part_xyz_mm: Coordinates | None
    """Ball centres in the part's system; null without an alignment."""
    covariance_mm2: Covariances | None
    """Covariances of xyz_mm, as in a point; null in a block of points where it is not
    known."""
    quality: Bits
    """Bits of the table of quality flags, point by point; 0: nothing to say."""
    dropped: Count
    """Points of this scan dropped so far because a queue was full."""
    lost: Count
    """Samples of this scan lost so far between device and daemon."""
    last: bool
    """True in the block that ends the scan; it may have no points."""
    total: Count | None
    """In the last block the number of points of the scan, dropped ones included."""
    in_doubt: Count
    """Points of this scan so far that are not `ok`, those here included."""

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        n = len(self.dtime_ns)
        for name in ARRAYS:
            array = getattr(self, name)
            if array is not None and len(array) != n:
                raise ValueError(f"{n} rows in {name} as in dtime_ns, not {len(array)}")
        if self.counts is not None and self.counts.shape != self.angles_rad.shape:
            raise ValueError("as many joints in counts as in angles_rad")
        if n and (self.dtime_ns[0] < 0 or (np.diff(self.dtime_ns) < 0).any()):
            raise ValueError("dtime_ns from 0 upwards, never decreasing")
        if self.last == (self.total is None):
            raise ValueError("a total in the last block, null in all others")
        return self
