"""Points in a signed chain: the signed bytes, and a reader's checks.

The content of a point is its MessagePack form with `signature` null, and without
`time_bound_ns` where that is null: points from before there was one have the same
content. Its link is the
SHA-256 of that, in hexadecimal; `previous` is the link of the point before it in the
session, of the first one the SHA-256 of the session's name. The signature is Ed25519
(RFC 8032) over the content. So a point that was removed, altered, inserted or moved
breaks the chain; not so the last points of a session that are missing.
"""

import hashlib
from base64 import b64decode
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import msgpack

from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Point

Verify = Callable[[bytes, bytes], object]
"""Called with signature and content; raises where they do not belong together."""
MOST_SESSIONS = 1000
MOST_LINKS = 100_000


def first_link(session: str) -> str:
    return hashlib.sha256(session.encode()).hexdigest()


def content_of(point: Point) -> bytes:
    left_out = {"time_bound_ns"} if point.time_bound_ns is None else None
    unsigned = point.model_copy(update={"signature": None})
    content: bytes = msgpack.packb(unsigned.model_dump(exclude=left_out))
    return content


def link_to(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@dataclass(slots=True)
class _Session:
    next_seq: int = 0
    links: OrderedDict[int, str] = field(default_factory=OrderedDict)


class PointChain:
    """Checks points in the order in which they are read; of any number of sessions.

    Args:
        verify: The check of a signature, see `verifier`.
    """

    def __init__(self, verify: Verify, invalid: type[Exception]) -> None:
        self._verify, self._invalid = verify, invalid
        self._sessions: OrderedDict[str, _Session] = OrderedDict()

    def problem(self, point: Point) -> str | None:
        """Name a fault of the next point, or of those before it; else None.

        A repeated point is no problem. After a problem the chain goes on from the
        point, if its own signature is right.
        """
        label = f"point {point.seq} of session {point.session}"
        if point.signature is None or point.previous is None:
            return f"{label} is not signed"
        content = content_of(point)
        try:
            self._verify(b64decode(point.signature), content)
        except self._invalid:
            return f"{label} was altered, or signed by another key"
        chain = self._sessions.setdefault(point.session, _Session())
        if len(self._sessions) > MOST_SESSIONS:
            self._sessions.popitem(last=False)
        link, problem = link_to(content), None
        if point.seq < chain.next_seq:
            known = chain.links.get(point.seq, link)
            if known == link:
                return None
            return f"{label} is another than the one read before under this number"
        if point.seq > chain.next_seq:
            last = point.seq - 1
            numbers = f"{chain.next_seq} to {last}" if last > chain.next_seq else last
            problem = f"{label}: {numbers} before it is missing, or comes later"
        else:
            before = chain.links.get(point.seq - 1, first_link(point.session))
            if point.previous != before:
                problem = f"{label} does not follow from the one before it"
        chain.next_seq = point.seq + 1
        chain.links[point.seq] = link
        if len(chain.links) > MOST_LINKS:
            chain.links.popitem(last=False)
        return problem


@dataclass(slots=True)
class CheckedPoints:
    """Result of a check of many points.

    Attributes:
        last: Number of the last point of each session; a chain cannot show whether more
            were taken.
    """

    n_points: int = 0
    problems: list[str] = field(default_factory=list)
    last: dict[str, int] = field(default_factory=dict)


def checked_points(points: Iterable[Point | str], public_key: bytes) -> CheckedPoints:
    """Check points in the order in which they are stored; a text is a problem itself.

    Raises:
        ValueError: That is no key.
        ModuleNotFoundError: As `verifier`.
    """
    chain, checked = verifier(public_key), CheckedPoints()
    for point in points:
        problem: str | None = point if isinstance(point, str) else chain.problem(point)
        if problem is not None:
            checked.problems.append(problem)
        if isinstance(point, Point):
            checked.n_points += 1
            checked.last[point.session] = point.seq
    return checked


def points_of_lines(lines: Iterable[str]) -> Iterator[Point | str]:
    """Read points as JSON, one a line; a text names an invalid line."""
    rows, number = iter(lines), 0
    while True:
        number += 1
        try:
            line = next(rows)
        except StopIteration:
            return
        except ValueError as error:
            yield f"cannot be read from line {number} on, or near it: {error}"
            return
        try:
            yield decode(Point, line.encode(), "json")
        except MessageError as error:
            yield f"line {number} is no point: {error}"


def verifier(public_key: bytes) -> PointChain:
    """Return the check of points signed by a key, its 32 bytes.

    Raises:
        ValueError: It is no such key.
        ModuleNotFoundError: cryptography is not installed.
    """
    from cryptography.exceptions import InvalidSignature  # noqa: PLC0415 - an extra
    from cryptography.hazmat.primitives.asymmetric.ed25519 import (  # noqa: PLC0415
        Ed25519PublicKey,
    )

    key = Ed25519PublicKey.from_public_bytes(public_key)
    return PointChain(key.verify, InvalidSignature)


def read_public_key(text: str) -> bytes:
    """Read a public key as `status` has it and as its file has it, base 64.

    Raises:
        ValueError: It is not a public key.
    """
    key = b64decode(text.strip(), validate=True)
    if len(key) != 32:
        raise ValueError(f"has {len(key)} bytes, expected 32 in base 64")
    return key
