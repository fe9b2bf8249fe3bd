"""Sessions one after the other: the current one, past ones, later ones."""

from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from traverse.client.results import StoredSession
from traverse.protocol.messages import Point


@dataclass(frozen=True, slots=True)
class Lost:
    """Unavailable points.

    Attributes:
        from_seq, to_seq: the first and the last; ``to_seq`` None: unknown number, if
            any.
    """

    session: str
    from_seq: int
    to_seq: int | None
    reason: str

    def __str__(self) -> str:
        last = "?" if self.to_seq is None else self.to_seq
        return f"points {self.from_seq} to {last} are lost: {self.reason}"


class SessionPoints:
    """A session whose points are taken in the order of their numbers.

    Attributes:
        begun_ns: its beginning [UTC].
        next_seq: the next number in turn.
        known: the highest number known to exist; -1 before the first.
        has_ended: no number above `known` will follow.
        needs_confirmation: the outbox has to confirm this session.
        cut: why it is unknown what followed `known`; else empty.
        held: points that arrived before their turn, by number.
    """

    def __init__(self, session: str, begun_ns: int, next_seq: int = 0) -> None:
        self.session = session
        self.begun_ns = begun_ns
        self.next_seq = next_seq
        self.known = next_seq - 1
        self.has_ended = False
        self.needs_confirmation = False
        self.cut = ""
        self.held: dict[int, Point] = {}

    @property
    def is_complete(self) -> bool:
        """Whether it has ended and everything of it was passed on."""
        return self.has_ended and self.next_seq > self.known

    def missing(self) -> tuple[int, int] | None:
        end = min(self.held) - 1 if self.held else self.known
        return None if end < self.next_seq else (self.next_seq, end)

    def see(self, seq: int) -> None:
        self.known = max(self.known, seq)

    def run(self) -> list[Point]:
        """Return points in turn; they count as passed on."""
        points = []
        while (point := self.held.pop(self.next_seq, None)) is not None:
            points.append(point)
            self.next_seq += 1
        return points

    def give_up(self, to_seq: int, reason: str) -> list[Point | Lost]:
        """Continue after gaps that cannot be filled, up to a number.

        Returns:
            The gaps, and the points that are here.
        """
        self.see(to_seq)
        points_and_gaps: list[Point | Lost] = [*self.run()]
        while self.next_seq <= to_seq:
            end = min([to_seq, *(seq - 1 for seq in self.held)])
            points_and_gaps.append(Lost(self.session, self.next_seq, end, reason))
            self.next_seq = end + 1
            points_and_gaps += self.run()
        return points_and_gaps


MAX_PAST = 2000
NEVER_FOLLOWED = -1
FORGOTTEN = "the arm's outbox holds them no more"
DAMAGED = "they are damaged in the arm's outbox"


class SessionSequence:
    """Sessions in the order in which they began; the first is the head.

    Args:
        since: next numbers of sessions that were followed before; None begins now.
        is_whole: begins with all stored points of the session.

    Attributes:
        anchor: the arm's session when following began, if `since` is None.
        has_begun: the list of sessions is known.
        start: next numbers at the beginning.
    """

    def __init__(
        self, since: Mapping[str, int] | None, *, is_whole: bool = False
    ) -> None:
        self._since = None if since is None else dict(since)
        self._is_whole = is_whole
        self._sessions: dict[str, SessionPoints] = {}
        self._past: OrderedDict[str, int] = OrderedDict()
        self.anchor: str | None = None
        self.has_begun = False
        self.start: dict[str, int] = dict(since or {})

    def __len__(self) -> int:
        return len(self._sessions)

    def __iter__(self) -> Iterator[SessionPoints]:
        return iter(self._sessions.values())

    @property
    def head(self) -> SessionPoints | None:
        return next(iter(self._sessions.values()), None)

    @property
    def begins_now(self) -> bool:
        return self._since is None

    def get(self, session: str) -> SessionPoints | None:
        return self._sessions.get(session)

    def past(self, session: str) -> int | None:
        """Return the next number of a past session; None if it is not past."""
        return self._past.get(session)

    def begin_without_list(self) -> None:
        self.has_begun = True
        for session, next_seq in (self._since or {}).items():
            self._sessions[session] = SessionPoints(session, 0, next_seq)

    def list(
        self, held: Sequence[StoredSession], lowest: Mapping[str, int], *, is_old: bool
    ) -> None:
        """Take the outbox's list of sessions, oldest first.

        Args:
            held: sessions in the outbox.
            lowest: the lowest numbers received so far, by session.
            is_old: others may have begun since the request.
        """
        if not self.has_begun:
            self.has_begun = True
            self._begin(held, lowest)
            self.start = self.start or {
                points.session: points.next_seq for points in self
            }
        names = [stored.session for stored in held]
        for stored in held:
            self._note(stored)
        for name, followed in list(self._sessions.items()):
            if name in names:
                followed.has_ended = followed.has_ended or name != names[-1]
            elif is_old:
                continue
            elif followed.known < 0:
                del self._sessions[name]  # it had no points, and is not listed
            elif not followed.has_ended:
                followed.needs_confirmation = True

    def adopt(self, session: str, first: int, begun_ns: int) -> SessionPoints:
        """Follow an unlisted session, inserted by its time."""
        followed = SessionPoints(session, begun_ns, first)
        sessions = list(self._sessions.values())
        position = len(sessions)
        while position and sessions[position - 1].begun_ns > begun_ns:
            position -= 1
        sessions.insert(position, followed)
        self._sessions = {points.session: points for points in sessions}
        return followed

    def leave(self, head: SessionPoints) -> None:
        self._pass(head.session, head.next_seq)
        del self._sessions[head.session]

    def _begin(self, held: Sequence[StoredSession], lowest: Mapping[str, int]) -> None:
        """Set where each session begins; earlier points are past."""
        names = [stored.session for stored in held]
        if self._since is None:
            start = names.index(self.anchor) if self.anchor in names else len(names) - 1
        else:
            start = max((names.index(s) for s in self._since if s in names), default=0)
        for name in names[: max(0, start)]:
            self._pass(name, NEVER_FOLLOWED)
        if self._since is None:
            for stored in held[start : start + 1] if names else ():
                end = 0 if stored.last_seq is None else stored.last_seq + 1
                next_seq = min(end, lowest.get(stored.session, end))
                if self._is_whole:
                    next_seq = stored.first_seq or 0
                followed = SessionPoints(stored.session, stored.begun_ns, next_seq)
                self._sessions[stored.session] = followed
        elif self._since and not set(names) & set(self._since):
            newest, next_seq = list(self._since.items())[-1]
            self._sessions[newest] = SessionPoints(newest, 0, next_seq)

    def _note(self, stored: StoredSession) -> None:
        if stored.session in self._past:
            return
        followed = self._sessions.get(stored.session)
        if followed is None:
            next_seq = (self._since or {}).get(stored.session, 0)
            followed = SessionPoints(stored.session, stored.begun_ns, next_seq)
            self._sessions[stored.session] = followed
        followed.begun_ns = stored.begun_ns
        if stored.last_seq is not None:
            followed.see(stored.last_seq)
        followed.cut = (
            FORGOTTEN if stored.last_seq is None and followed.known >= 0 else ""
        )

    def _pass(self, session: str, next_seq: int) -> None:
        self._past[session] = next_seq
        while len(self._past) > MAX_PAST:
            self._past.popitem(last=False)
