"""What commands give back, typed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from traverse.protocol.message_error import MessageError


@dataclass(frozen=True, slots=True)
class CapturedPoint:
    """Which point a command has made."""

    session: str
    seq: int
    id: str

    @classmethod
    def read(cls, result: Mapping[str, Any]) -> Self:
        """From the answer to `point` or `undo`."""
        return cls(_text(result, "session"), _count(result, "seq"), _text(result, "id"))


@dataclass(frozen=True, slots=True)
class HeldSession:
    """A session that the arm's outbox holds points of.

    Attributes:
        begun_ns: when it began [UTC].
        first_seq, last_seq: the numbers held; None where none is.
    """

    session: str
    begun_ns: int
    first_seq: int | None
    last_seq: int | None

    @classmethod
    def read(cls, result: Mapping[str, Any]) -> Self:
        """From one element of the list of sessions."""
        return cls(
            _text(result, "session"),
            _time(result, "begun_ns"),
            _count_or_none(result, "first_seq"),
            _count_or_none(result, "last_seq"),
        )

    @classmethod
    def read_all(cls, result: Mapping[str, Any]) -> "tuple[Self, ...]":
        """From the answer to `resend` without a session, oldest first."""
        found = result.get("sessions")
        if not isinstance(found, list | tuple):
            raise MessageError.of("result.sessions", repr(found)[:80], "a list")
        return tuple(cls.read(one) for one in found)


@dataclass(frozen=True, slots=True)
class Resent:
    """What the arm will send again, and what its outbox holds of the session.

    Attributes:
        points: so many will follow.
        first_seq, last_seq: the numbers held; None where none is.
    """

    session: str
    points: int
    first_seq: int | None
    last_seq: int | None

    @classmethod
    def read(cls, result: Mapping[str, Any]) -> Self:
        """From the answer to `resend` with a session."""
        return cls(
            _text(result, "session"),
            _count(result, "points"),
            _count_or_none(result, "first_seq"),
            _count_or_none(result, "last_seq"),
        )


@dataclass(frozen=True, slots=True)
class ResentScan:
    """What the arm will send again of a scan, and what it holds of it.

    Attributes:
        session: in which it was made; None where the arm holds nothing of it.
        blocks: so many will follow.
        first_seq, last_seq: points held; None where none is.
        total: points of the scan; None before its end, or where that is not held.
    """

    scan: str
    session: str | None
    blocks: int
    first_seq: int | None
    last_seq: int | None
    total: int | None

    @classmethod
    def read(cls, result: Mapping[str, Any]) -> Self:
        """From the answer to `resend` with a scan."""
        session = result.get("session")
        return cls(
            _text(result, "scan"),
            None if session is None else _text(result, "session"),
            _count(result, "blocks"),
            _count_or_none(result, "first_seq"),
            _count_or_none(result, "last_seq"),
            _count_or_none(result, "total"),
        )


@dataclass(frozen=True, slots=True)
class StartedScan:
    """A scan that has begun.

    Attributes:
        scan: its identifier, as in its blocks.
        rate_hz: points per second; None where they are spaced otherwise.
    """

    scan: str
    rate_hz: float | None

    @classmethod
    def read(cls, result: Mapping[str, Any]) -> Self:
        """From the answer to `scan` start."""
        rate_hz = result.get("rate_hz")
        if rate_hz is not None and not isinstance(rate_hz, int | float):
            raise MessageError.of("result.rate_hz", repr(rate_hz)[:80], "a number")
        return cls(_text(result, "scan"), rate_hz)


def _text(result: Mapping[str, Any], name: str) -> str:
    value = result.get(name)
    if not isinstance(value, str):
        raise MessageError.of(f"result.{name}", repr(value)[:80], "a text")
    return value


def _count(result: Mapping[str, Any], name: str) -> int:
    value = _count_or_none(result, name)
    if value is None:
        raise MessageError.of(f"result.{name}", "null", "an integer from 0")
    return value


def _count_or_none(result: Mapping[str, Any], name: str) -> int | None:
    value = result.get(name)
    if value is None:
        return None
    if type(value) is not int or value < 0:
        raise MessageError.of(f"result.{name}", repr(value)[:80], "an integer from 0")
    return value


def _time(result: Mapping[str, Any], name: str) -> int:
    """Nanoseconds, which need more digits than JSON's numbers have."""
    value = result.get(name)
    if isinstance(value, str) and value.isascii() and value.isdigit():
        return int(value)
    return _count(result, name)
