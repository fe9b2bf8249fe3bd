"""Point: one captured point, or the retraction of one."""

from html import escape
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from traverse.protocol.messages.fields import (
    Angles,
    ArmName,
    Count,
    Counts,
    Digest,
    Message,
    Name,
    NotNegative,
    TimeNs,
    Value,
    Vector,
    schema_field,
)
from traverse.protocol.messages.quality import Quality

Trigger = Literal["button", "switch", "timer", "command"]
Compensation = Literal["none", "shank", "pretouch", "pulled", "inside", "outside"]
SIGNATURE_PATTERN = "^[A-Za-z0-9+/]{86}==$"
Covariance = tuple[float, float, float, float, float, float]


class Label(Value):
    """The artefact and feature of a point, as in a campaign's poses."""

    artefact: Name | None = None
    """Identifier of the artefact; null: not stated."""
    feature: Name | None = None
    """Feature of the artefact; null where it has only one."""

    @model_validator(mode="after")
    def _names_an_artefact(self) -> Self:
        if self.artefact is None and self.feature is not None:
            raise ValueError("an artefact where there is a feature")
        return self


class Point(Message):
    """A captured point, or the retraction of one: counts once per `id`."""

    schema_: Literal["traverse/point/1"] = schema_field("traverse/point/1")
    session: Name
    """Session of the numbering."""
    seq: Count
    """Number within the session, from 0, without gaps."""
    id: Name
    """Unique for ever; a point delivered twice has the same."""
    retracts: Name | None
    """Null for a capture; else the `id` of the point that this takes back."""
    arm: ArmName
    """Name of the arm."""
    model: Digest
    """Digest of the arm file that the coordinates were computed with."""
    trigger: Trigger
    """What requested this point."""
    time_ns: TimeNs
    """Instant of the measurement; of the undo in a retraction. [UTC]"""
    time_bound_ns: Count | None = None
    """How far `time_ns` may be off by the clocks of devices, beside UTC itself; null:
    not stated."""
    xyz_mm: Vector
    """Ball centre in the arm's system."""
    ijk: Vector
    """Unit vector of the shank, from the wrist to the ball, in the arm's system."""
    surface_mm: Vector | None
    """Touched point in the arm's system; null without compensation."""
    compensation: Compensation
    """How the side of the material was found."""
    part_xyz_mm: Vector | None
    """Ball centre in the part's system; null without an alignment."""
    covariance_mm2: Covariance | None
    """Covariance of xyz_mm: xx, xy, xz, yy, yz, zz; null where it is not known."""
    angles_rad: Angles
    """Readings of the joints from the base outwards, uncorrected, unwrapped."""
    counts: Counts
    """Counts of the joints, unwrapped, as latched; of averaged points the last."""
    temperature_c: float | None
    """Temperature used for corrections; null without a sensor."""
    probe_radius_mm: NotNegative
    """Radius of the ball."""
    samples: Annotated[int, Field(ge=1, le=1_000_000)]
    """How many samples were averaged."""
    spread_mm: NotNegative | None
    """Root mean square distance of the samples from their mean; null for one sample."""
    label: Label
    """What was touched."""
    quality: Quality
    """Whether the point may be trusted."""
    previous: Digest | None = None
    """Link to the point before it in the session; null unless points are signed."""
    signature: Annotated[str, Field(pattern=SIGNATURE_PATTERN)] | None = None
    """Ed25519 over the point, base 64; null unless points are signed."""

    def retraction(
        self, *, seq: int, point_id: str, trigger: Trigger, time_ns: int
    ) -> Self:
        """The message that takes this point back; it repeats the measurement."""
        fields: dict[str, object] = {
            **dict(self),
            "seq": seq,
            "id": point_id,
            "retracts": self.id,
            "trigger": trigger,
            "time_ns": time_ns,
        }
        fields.pop("schema_")
        return type(self).model_validate(fields)

    def _repr_html_(self) -> str:
        """Show it in a notebook: coordinates with U (k = 2), and doubts."""
        covariance_mm2 = self.covariance_mm2 or (None,) * 6
        variances_mm2 = (covariance_mm2[0], covariance_mm2[3], covariance_mm2[5])
        rows = [
            (
                axis,
                f"{mm:.4f} mm",
                "unknown" if mm2 is None else f"{2 * mm2**0.5:.4f} mm",
            )
            for axis, mm, mm2 in zip("xyz", self.xyz_mm, variances_mm2, strict=True)
        ]
        cells = "".join(
            f"<tr><th>{axis}</th><td>{mm}</td><td>{u}</td></tr>" for axis, mm, u in rows
        )
        doubts = ", ".join(self.quality.flags) or "unstated"
        state = "ok" if self.quality.ok else f"in doubt: {doubts}"
        about = f"{self.arm}, session {self.session}, point {self.seq}: {state}"
        return (
            f"<table><caption>{escape(about)}</caption>"
            f"<tr><th></th><th>centre</th><th>U (k = 2)</th></tr>{cells}</table>"
        )

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        if len(self.angles_rad) != len(self.counts):
            raise ValueError(
                f"as many counts as angles_rad, not {len(self.counts)} and "
                f"{len(self.angles_rad)}"
            )
        if (self.surface_mm is None) != (self.compensation == "none"):
            raise ValueError(
                'surface_mm null with compensation "none", given with any other'
            )
        if self.retracts == self.id:
            raise ValueError("an id other than that of the retracted point")
        return self
