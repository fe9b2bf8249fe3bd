"""Sessions one after the other: the current one, past ones, later ones."""

from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from traverse.client.results import StoredSession
from traverse.protocol.messages import Point


@dataclass(frozen=True, slots=True)
class Lost:
    """Points that cannot be had any more.

    Attributes:
        from_seq, to_seq: the first and the last of them; ``to_seq`` None: unknown
            how many there were, if any.
        reason: why, for people.
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
        session: its name.
        begun_ns: when it began [UTC].
        next_seq: the number that is handed on next.
        known: the highest number that is known to exist; -1 before the first.
        has_ended: whether no number above `known` will follow.
        needs_confirmation: whether the outbox has to confirm this session.
        cut: why it is unknown what followed `known`; empty where it is known.
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
        """Whether it has ended and everything of it has been handed on."""
        return self.has_ended and self.next_seq > self.known

    def missing(self) -> tuple[int, int] | None:
        """The first known gap: its first and last number."""
        end = min(self.held) - 1 if self.held else self.known
        return None if end < self.next_seq else (self.next_seq, end)

    def see(self, seq: int) -> None:
        """A point of this number exists."""
        self.known = max(self.known, seq)

    def run(self) -> list[Point]:
        """Points whose turn it is; they count as handed on."""
        points = []
        while (point := self.held.pop(self.next_seq, None)) is not None:
            points.append(point)
            self.next_seq += 1
        return points

    def give_up(self, to_seq: int, reason: str) -> list[Point | Lost]:
        """Continue after gaps that cannot be filled: all up to a number.

        Returns:
            What is handed on: the gaps, and the points that are here.
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
        is_whole: where it begins now, with all that is held of the session.

    Attributes:
        anchor: the arm's session when following began, where `since` is None.
        has_begun: whether it is known which sessions there are.
        start: next numbers where following began.
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
        """The session whose points are handed on now."""
        return next(iter(self._sessions.values()), None)

    @property
    def begins_now(self) -> bool:
        """Whether nothing is followed that was before."""
        return self._since is None

    def get(self, session: str) -> SessionPoints | None:
        """A session that is followed and not complete."""
        return self._sessions.get(session)

    def past(self, session: str) -> int | None:
        """The next number of a session that is past; None where it is not."""
        return self._past.get(session)

    def begin_without_list(self) -> None:
        """Begin without knowing which sessions there are."""
        self.has_begun = True
        for session, next_seq in (self._since or {}).items():
            self._sessions[session] = SessionPoints(session, 0, next_seq)

    def list(
        self, held: Sequence[StoredSession], lowest: Mapping[str, int], *, is_old: bool
    ) -> None:
        """The outbox has reported which sessions it holds, oldest first.

        Args:
            held: those.
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
        """Follow a session that is in no list, where it belongs by its time."""
        followed = SessionPoints(session, begun_ns, first)
        sessions = list(self._sessions.values())
        position = len(sessions)
        while position and sessions[position - 1].begun_ns > begun_ns:
            position -= 1
        sessions.insert(position, followed)
        self._sessions = {points.session: points for points in sessions}
        return followed

    def leave(self, head: SessionPoints) -> None:
        """The head is complete: continue with the next."""
        self._pass(head.session, head.next_seq)
        del self._sessions[head.session]

    def _begin(self, held: Sequence[StoredSession], lowest: Mapping[str, int]) -> None:
        """Set where following begins: earlier points are past."""
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
