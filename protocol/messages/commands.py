"""Commands: one envelope, and the arguments of each command.

The name of a command is in its topic, `cmd/<name>`; the payload holds the envelope.
Optional arguments may be left out or null. The daemon reads the envelope first and the
arguments then, so that a command with wrong arguments is answered by its `request`.
"""

import math
from typing import Annotated, ClassVar, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from traverse.protocol.messages.clock import Expiry
from traverse.protocol.messages.fields import (
    Angles,
    Count,
    Digest,
    Message,
    Name,
    Positive,
    Text,
    Value,
    Vector,
    schema_field,
)
from traverse.protocol.messages.plain import PlainMap
from traverse.protocol.messages.point import Label
from traverse.protocol.messages.scan import ScanMode

ROTATION_TOLERANCE = 1e-6
RECORDING_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$"


COMMANDS: dict[str, "type[Args]"] = {}
"""The arguments of each command, by its name."""


class Args(Value):
    """Arguments of one command, each key with its meaning."""

    model_config = ConfigDict(defer_build=True)  # most are never sent to a daemon

    command: ClassVar[str]
    """Last level of the command's topic."""
    is_repeatable: ClassVar[bool] = False
    """Carried out twice it has the same effect: clients may send it to a daemon that
    was restarted meanwhile."""

    @classmethod
    def __pydantic_init_subclass__(cls, **options: object) -> None:
        super().__pydantic_init_subclass__(**options)
        COMMANDS[cls.command] = cls


class PointArgs(Args):
    """Take a point now: one sample, or the mean of several."""

    command = "point"
    samples: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    """Average so many samples; null: one, or as `dwell_s` says."""
    dwell_s: Annotated[float, Field(gt=0, le=60)] | None = None
    """Average all samples of this time; not with `samples`."""

    @model_validator(mode="after")
    def _has_one_length(self) -> Self:
        if self.samples is not None and self.dwell_s is not None:
            raise ValueError("samples or dwell_s, not both")
        return self


class ScanArgs(Args):
    """Start or stop a scan; a start replaces a running scan."""

    command = "scan"
    action: Literal["start", "stop"]
    """With "stop" all other keys are ignored."""
    mode: ScanMode = "time"
    """Points by time, by distance travelled, or at crossings of parallel planes."""
    rate_hz: Annotated[float, Field(gt=0, le=10_000)] | None = None
    """Points per second in mode "time"; null: as configured."""
    spacing_mm: Positive | None = None
    """Distance between points, or between planes; needed in these two modes."""
    normal: Vector | None = None
    """Normal of the planes, any length above 0; needed in mode "planes"."""
    offset_mm: float = 0.0
    """Distance of one of the planes from the origin, along the normal."""
    held: bool = False
    """Record only while the button is held."""

    @model_validator(mode="after")
    def _has_what_the_mode_needs(self) -> Self:
        if self.action == "stop":
            return self
        if self.mode != "time" and self.spacing_mm is None:
            raise ValueError(f'spacing_mm in mode "{self.mode}"')
        if self.mode == "planes" and not any(self.normal or ()):
            raise ValueError('a normal of length above 0 in mode "planes"')
        return self


class UndoArgs(Args):
    """Take back the last point that is not yet taken back."""

    command = "undo"
    id: Name | None = None
    """Refused unless this is the last point; guards against undoing another."""


class LabelArgs(Args, Label):
    """Set the artefact and feature of the next points; both null ends it."""

    command = "label"
    is_repeatable = True


class ProbeArgs(Args):
    """Change the probe."""

    command = "probe"
    is_repeatable = True
    name: Name
    """Name in the probe library."""


class ReferenceArgs(Args):
    """Accept devices and the present positions of their encoders as right.

    The result is `{confirmed: [...], accepted: [...], remembered}`: ids of the devices
    that were in doubt, what was accepted of each in words, as "was AAA111, is BBB222",
    and whether that is on the disk.
    """

    command = "reference"
    action: Literal["confirm"]
    """The only one."""
    at_xyz_mm: Vector | None = None
    """Where the probe is known to be, in the arm's system; refused if it is not."""
    tolerance_mm: Positive = 1.0
    """How far from there it may be."""
    utc: bool = False
    """Accept the computer's UTC as right, and no positions; confirmed is `["utc"]`."""


class HomeArgs(Args):
    """Set the counts: the joints are now at the home posture of the arm file.

    The result is `{homed: [...], confirmed: [...], accepted: [...], remembered}`: names
    of the joints, and the rest as that of `reference`.
    """

    command = "home"
    joints: Annotated[tuple[Name, ...], Field(min_length=1, max_length=64)] | None = (
        None
    )
    """Which; null: all of the home posture that have no absolute encoder."""


class ReloadArgs(Args):
    """Read arm file and configuration again, between two samples."""

    command = "reload"
    is_repeatable = True


class AlignArgs(Args):
    """Set or clear the alignment: part = scale * rotation * arm + translation_mm."""

    command = "align"
    is_repeatable = True
    action: Literal["set", "clear"]
    """With "clear" all other keys are ignored."""
    name: Text | None = None
    """What the alignment is called."""
    rotation: tuple[Vector, Vector, Vector] | None = None
    """Rows of the rotation from the arm's to the part's system; needed to set."""
    translation_mm: Vector | None = None
    """The arm's origin in the part's system; needed to set."""
    scale: Positive = 1.0
    """Scale of the part's system against the arm's."""

    @model_validator(mode="after")
    def _is_a_rigid_motion(self) -> Self:
        if self.action == "clear":
            return self
        if self.rotation is None or self.translation_mm is None:
            raise ValueError("rotation and translation_mm to set an alignment")
        if not _is_rotation(self.rotation):
            raise ValueError(f"a proper rotation within {ROTATION_TOLERANCE}")
        return self


class SessionArgs(Args):
    """Begin a new session: numbering starts again at 0."""

    command = "session"
    action: Literal["new"]
    """The only one."""
    note: Text | None = None
    """For people; stored with the session."""


class ResendArgs(Args):
    """Send points or scan blocks again to all, in order, with the same ids and bytes.

    - With `session`: points of the outbox. Result `{session, from_seq, to_seq, points,
      first_seq, last_seq}`: how many will be sent, and which are stored, null for none.
    - With `scan`: the blocks that hold the points, of scans with `delivery =
      "complete"`. Result `{scan, session, from_seq, to_seq, blocks, first_seq,
      last_seq, total}`; the total is null before the scan's end.
    - With neither: nothing is sent. Result `{sessions: [{session, begun_ns, first_seq,
      last_seq}], scans: [{scan, session, begun_ns, first_seq, last_block_seq}],
      doubts}`, oldest first, the latest 1000 of each; times are strings of digits. The
      latest 200 `doubts` are `data` of events that name numbers sent before.
    """

    command = "resend"
    is_repeatable = True
    session: Name | None = None
    """Session of the points; not with `scan`."""
    scan: Name | None = None
    """Scan of the blocks; not with `session`."""
    from_seq: Count = 0
    """First number."""
    to_seq: Count | None = None
    """Last number, itself included; null: the newest."""

    @model_validator(mode="after")
    def _goes_upwards(self) -> Self:
        if self.to_seq is not None and self.to_seq < self.from_seq:
            raise ValueError("to_seq not below from_seq")
        if self.session is not None and self.scan is not None:
            raise ValueError("a session or a scan, not both")
        return self


class RecordArgs(Args):
    """Start or stop a recording on the daemon's disk."""

    command = "record"
    action: Literal["start", "stop"]
    """With "stop" all other keys are ignored."""
    name: Annotated[str, Field(pattern=RECORDING_NAME)] | None = None
    """Of the file, without its ending; needed to start, and new."""
    note: Text | None = None
    """For people; stored in the file."""

    @model_validator(mode="after")
    def _has_a_name(self) -> Self:
        if self.action == "start" and self.name is None:
            raise ValueError("a name to start")
        return self


class Reading(Value):
    """Of all joints at one instant."""

    angles_rad: Angles
    """As of a point or of a sample of a scan."""
    utc_s: Annotated[float, Field(ge=0, le=9.2e9)]
    """When they were read, in seconds since 1970 [UTC]: for drifts of the arm."""


class CovarianceArgs(Args):
    """State how the errors of points belong together, for lengths between them.

    Errors of an arm's parameters are shared by its points. The result is `{model,
    with_arm, points: [{id, xyz_mm, covariance_mm2, shared_mm}]}`: of each point its own
    covariance as the point has it, and three rows S; points i and j have the covariance
    S_i S_j^T. Without a covariance file of the arm `with_arm` is false, rows are empty,
    and the arm's part is not in `covariance_mm2` either.

    The same of readings, such as those of a scan, in place of `ids`: the result is
    `{model, with_arm, shared_mm}`, the rows S of each reading; they are at rest, at the
    arm's present temperature.
    """

    command = "covariance"
    ids: Annotated[tuple[Name, ...], Field(max_length=100)] = ()
    """Of the points, all measured with one model."""
    model: Digest | None = None
    """Digest of the arm file that readings are of: the one in use."""
    readings: Annotated[tuple[Reading, ...], Field(max_length=100)] = ()
    """With `model`, in place of `ids`."""

    @model_validator(mode="after")
    def _asks_for_one_kind(self) -> Self:
        if bool(self.ids) == bool(self.readings) or (
            bool(self.readings) != (self.model is not None)
        ):
            raise ValueError("ids, or else readings with their model")
        return self


class Command(Message):
    """The envelope of every command."""

    schema_: Literal["traverse/command/1"] = schema_field("traverse/command/1")
    request: Name
    """Chosen by the sender, unique for it; repeated, it gets the first reply again."""
    args: PlainMap
    """The arguments of the command that the topic names."""
    expires: Expiry | None = None
    """Until when it may be begun; null: within 5 s, as far as the daemon can tell."""

    @classmethod
    def carrying(cls, args: Args, request: str, expires: Expiry | None = None) -> Self:
        """The envelope around typed arguments; omitted keys stay out."""
        values = args.model_dump(exclude_unset=True)
        return cls(request=request, args=values, expires=expires)


def _is_rotation(rows: tuple[Vector, Vector, Vector]) -> bool:
    """Rows of length 1, and the third the cross product of the first two."""
    (ax, ay, az), (bx, by, bz), third = rows
    cross = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    first_two = ((ax, ay, az), (bx, by, bz))
    return (
        all(abs(math.hypot(*row) - 1) <= ROTATION_TOLERANCE for row in first_two)
        and math.dist(cross, third) <= ROTATION_TOLERANCE
        and (abs(ax * bx + ay * by + az * bz) <= ROTATION_TOLERANCE)
    )
