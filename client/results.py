"""Typed results of commands."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from traverse.protocol.message_error import MessageError
from traverse.protocol.messages.fields import MAX_TIME_NS, Count, Vector
from traverse.protocol.messages.later_doubt import LaterDoubt
from traverse.protocol.messages.point import Covariance

if TYPE_CHECKING:
    from traverse.kinematics.uncertainty.joint_covariance import JointCovariance


def _time(value: object) -> object:
    """Parse nanoseconds, which have more digits than numbers of JSON."""
    is_digits = isinstance(value, str) and value.isascii() and value.isdigit()
    return int(str(value)) if is_digits else value


class CommandResult(BaseModel):
    """Result of a command; unknown keys of a newer daemon are dropped."""

    model_config = ConfigDict(frozen=True, strict=True, extra="ignore")

    @classmethod
    def read(cls, result: object) -> Self:
        """Read the result in a reply.

        Raises:
            MessageError: it is no such result; lists all mistakes.
        """
        try:
            return cls.model_validate(result)
        except ValidationError as error:
            raise MessageError.from_validation("result", error) from error


class CapturedPoint(CommandResult):
    """The point made by the command `point` or `undo`."""

    session: str
    seq: Count
    id: str


class StoredSession(CommandResult):
    """A session in the arm's outbox.

    Attributes:
        begun_ns: its beginning [UTC].
        first_seq, last_seq: stored numbers, or None.
    """

    session: str
    begun_ns: Annotated[int, Field(ge=0, le=MAX_TIME_NS), BeforeValidator(_time)]
    first_seq: Count | None = None
    last_seq: Count | None = None

    @classmethod
    def read_all(cls, result: Mapping[str, Any]) -> "tuple[Self, ...]":
        """Read the result of `resend` without a session, oldest first."""
        sessions = result.get("sessions")
        if not isinstance(sessions, list | tuple):
            raise MessageError.of("result.sessions", repr(sessions)[:80], "a list")
        return tuple(cls.read(session) for session in sessions)


def doubts_of(result: Mapping[str, Any]) -> list[LaterDoubt]:
    """Read what is in doubt since it was sent, from a result of `resend`.

    Raises:
        MessageError: it is none.
    """
    stated = result.get("doubts", ())
    try:
        return [doubt for data in stated if (doubt := LaterDoubt.of(dict(data)))]
    except (TypeError, ValueError) as error:
        expected = "a list of data of events"
        raise MessageError.of("result.doubts", repr(stated)[:80], expected) from error


class StoredScan(CommandResult):
    """A scan with blocks on the arm.

    Attributes:
        begun_ns: its beginning [UTC].
        last_block_seq: number of the first point of the last block; None without one.
    """

    scan: str
    session: str
    begun_ns: Annotated[int, Field(ge=0, le=MAX_TIME_NS), BeforeValidator(_time)]
    last_block_seq: Count | None = None


class Resent(CommandResult):
    """Points that the arm will send again, and its stored ones of the session.

    Attributes:
        first_seq, last_seq: stored numbers, or None.
    """

    session: str
    points: Count
    first_seq: Count | None = None
    last_seq: Count | None = None


class ResentScan(CommandResult):
    """Blocks that the arm will send again, and its stored ones of the scan.

    Attributes:
        session: of the scan; None if nothing of it is stored.
        first_seq, last_seq: stored points, or None.
        total: points of the scan; None before its end, or if that is not stored.
    """

    scan: str
    session: str | None = None
    blocks: Count
    first_seq: Count | None = None
    last_seq: Count | None = None
    total: Count | None = None


class StartedScan(CommandResult):
    """A scan that has begun.

    Attributes:
        scan: its identifier, as in its blocks.
        rate_hz: points per second; None if they are spaced otherwise.
    """

    scan: str
    rate_hz: float | None = None


Factor = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]


class SharedErrors(CommandResult):
    """What readings share by the arm, see `CovarianceArgs`; in mm."""

    shared_mm: tuple[Factor, ...]


class SharedPoint(CommandResult):
    """One point of an answer to `covariance`; lengths in mm."""

    id: str
    xyz_mm: Vector
    covariance_mm2: Covariance
    shared_mm: Factor


class PointCovariances(CommandResult):
    """Covariances between points, see `CovarianceArgs`."""

    points: tuple[SharedPoint, ...]

    def joint(self) -> "JointCovariance":
        """Convert to one covariance, for lengths and features."""
        from traverse.kinematics.uncertainty.joint_covariance import (  # noqa: PLC0415 - numpy's fits, for those who want them
            JointCovariance,
            covariances_of,
        )

        tensors = np.array([point.covariance_mm2 for point in self.points])
        return JointCovariance(
            np.array([point.xyz_mm for point in self.points]),
            covariances_of(tensors),
            np.array([point.shared_mm for point in self.points]),
        )
