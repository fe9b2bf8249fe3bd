"""Order of points from a broker, without gap and without repeat.

A broker delivers points late, twice, or not at all (mosquitto, when it is killed).
Missing numbers in (session, seq) are requested again from the arm's outbox; points that
it does not have any more are reported as `Lost`. Sessions follow one another in the
order of their begin. No clock and no connection here: `traverse.client.points.stream`
has them.

Law: output is in order of (session, seq), each number of a followed session once, as a
point or within a `Lost`. Only points of a session that was taken for complete may come
late.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from traverse.client.points.session_order import (
    DAMAGED,
    FORGOTTEN,
    NEVER_FOLLOWED,
    Lost,
    SessionSequence,
)
from traverse.client.results import Resent, StoredSession
from traverse.protocol.messages import Point

BATCH = 500
"""Points requested at once; brokers keep 1000 for a slow client."""
MAX_HELD = 2000
UNKNOWN = "the arm's outbox does not know this session any more"


@dataclass(frozen=True, slots=True)
class ResendRequest:
    """A request to the outbox.

    Attributes:
        session: None requests the list of sessions.
        is_tail: it is not known whether there are such points.
    """

    session: str | None
    from_seq: int = 0
    to_seq: int = 0
    is_tail: bool = False


class ReorderBuffer:
    """Takes points as they arrive; `ready` holds those in turn.

    Args:
        since: next numbers of sessions that were followed before; None begins with
            points from now on, an empty map with everything in the outbox.
        is_whole: begins with all stored points of the arm's session.

    Attributes:
        needs_session_list: the list of sessions has to be requested.
        ready: points and losses in their order, to be taken from the left.
        n_requested: number of points requested again.
    """

    def __init__(
        self, since: Mapping[str, int] | None, *, is_whole: bool = False
    ) -> None:
        self.sessions = SessionSequence(since, is_whole=is_whole)
        self._unknown_sessions: dict[str, dict[int, Point]] = {}
        self._refusal: str | None = None
        self.needs_session_list = True
        self.ready: deque[Point | Lost] = deque()
        self.n_taken = 0
        self.duplicates = 0
        self.n_requested = 0

    @property
    def can_request(self) -> bool:
        """Whether the arm sends points again, as far as known."""
        return self._refusal is None

    @property
    def needs_request(self) -> bool:
        head = self.sessions.head
        return self.can_request and (
            self.needs_session_list
            or (
                head is not None
                and (head.next_seq <= head.known or head.needs_confirmation)
            )
        )

    @property
    def n_held(self) -> int:
        followed = sum(len(session.held) for session in self.sessions)
        return followed + sum(map(len, self._unknown_sessions.values()))

    def take(self, point: Point, *, room: bool = True) -> None:
        """Process a received point; without room it is only counted."""
        self.n_taken += 1
        followed = self.sessions.get(point.session)
        if followed is None:
            self._buffer_unknown(point)
            return
        if point.seq < followed.next_seq or point.seq in followed.held:
            self.duplicates += 1
            return
        followed.see(point.seq)
        is_next = followed is self.sessions.head and point.seq == followed.next_seq
        if not room or (not is_next and self.n_held >= MAX_HELD):
            return  # it is requested again
        followed.held[point.seq] = point
        if is_next or self._refusal is not None:
            self._hand_on()

    def notice(self, session: str) -> None:
        """Take the arm's present session."""
        self.sessions.anchor = self.sessions.anchor or session
        if self.sessions.get(session) is None and self.sessions.past(session) is None:
            self.needs_session_list = True

    def connection_restored(self) -> None:
        """Note a new connection: refused requests may be granted now."""
        self._refusal = None
        self.needs_session_list = True

    def next_request(self, room: int) -> ResendRequest | None:
        """Return the next request; None: nothing is known to be missing.

        It counts as sent; call `unanswered` if no answer arrived.
        """
        if self._refusal is not None:
            return None
        if self.needs_session_list:
            self.needs_session_list = (
                False  # unless something new arrives before the answer
            )
            return ResendRequest(None)
        head = self.sessions.head
        if head is None or room < 1:
            return None
        gap = head.missing()
        if gap is not None:
            first, last = gap
            return ResendRequest(
                head.session, first, min(last, first + min(room, BATCH) - 1)
            )
        return self.tail_request() if head.needs_confirmation else None

    def tail_request(self) -> ResendRequest:
        head = self.sessions.head
        if head is None:
            return ResendRequest(None)
        first = head.next_seq
        return ResendRequest(head.session, first, first + BATCH - 1, is_tail=True)

    def next_seq_of(self, session: str) -> int | None:
        """Return the next number of a session; None: it is complete."""
        followed = self.sessions.get(session)
        return None if followed is None else followed.next_seq

    def unanswered(self, ask: ResendRequest) -> None:
        self.needs_session_list = self.needs_session_list or ask.session is None

    def resent(self, ask: ResendRequest, answer: Resent) -> int | None:
        """Take an answer of the outbox.

        Returns:
            The last number that it will send, or None.
        """
        self.n_requested += answer.points
        head = self.sessions.head
        if head is None or head.session != ask.session:
            return None
        first, last = answer.first_seq, answer.last_seq
        if head.needs_confirmation:
            head.needs_confirmation, head.has_ended = False, True
            head.cut = UNKNOWN if last is None else ""
        if last is not None:
            head.see(last)
        if first is None or last is None or last < ask.from_seq:
            if not ask.is_tail:
                self.ready.extend(head.give_up(ask.to_seq, FORGOTTEN))
            self._hand_on()
            return None
        if not answer.points:  # it has points around these
            self.ready.extend(head.give_up(min(ask.to_seq, last), DAMAGED))
            self._hand_on()
            return None
        self.ready.extend(head.give_up(first - 1, FORGOTTEN))
        self._hand_on()
        return min(last, ask.to_seq)

    def refuse(self, reason: str) -> None:
        """Continue with new points, and report gaps: the arm cannot resend."""
        self._refusal = reason
        self.needs_session_list = False
        first_time = not self.sessions.has_begun
        if first_time:
            self.sessions.begin_without_list()
        self._adopt_unknown_sessions(
            from_lowest=first_time and self.sessions.begins_now
        )
        self._hand_on()

    def listed(self, sessions: Sequence[StoredSession]) -> None:
        """Take the outbox's list of sessions, oldest first."""
        lowest = {name: min(held) for name, held in self._unknown_sessions.items()}
        self.sessions.list(sessions, lowest, is_old=self.needs_session_list)
        self._adopt_unknown_sessions()
        self._hand_on()

    def _buffer_unknown(self, point: Point) -> None:
        past = self.sessions.past(point.session)
        held = self._unknown_sessions.get(point.session, {})
        is_past = past is not None and (past == NEVER_FOLLOWED or point.seq < past)
        if is_past or point.seq in held:
            self.duplicates += 1
            return
        self.needs_session_list = True
        if self.n_held >= MAX_HELD:
            return  # it is requested again
        self._unknown_sessions.setdefault(point.session, held)[point.seq] = point
        if self._refusal is not None:
            self.refuse(self._refusal)

    def _adopt_unknown_sessions(self, *, from_lowest: bool = False) -> None:
        unknown_sessions, self._unknown_sessions = self._unknown_sessions, {}
        for session, held in unknown_sessions.items():
            lowest = min(held)
            past = self.sessions.past(session)
            followed = self.sessions.get(session)
            if followed is None and past is None and self.needs_session_list:
                self._unknown_sessions[session] = held  # the next list may know it
                continue
            if followed is None and past == NEVER_FOLLOWED:
                self.duplicates += len(held)
                continue
            if followed is None:
                first = lowest if from_lowest else past or 0
                begun_ns = held[lowest].time_ns if past is None else 0
                followed = self.sessions.adopt(session, first, begun_ns)
                followed.has_ended = self._refusal is None
            for seq, point in held.items():
                followed.see(seq)
                if seq < followed.next_seq:
                    self.duplicates += 1
                else:
                    followed.held[seq] = point

    def _hand_on(self) -> None:
        """Move points in turn to `ready`, session by session."""
        while (head := self.sessions.head) is not None:
            self.ready.extend(head.run())
            if self._refusal is not None:
                self.ready.extend(head.give_up(head.known, self._refusal))
                head.has_ended = len(self.sessions) > 1
            if not head.is_complete:
                return
            if head.cut:
                lost = Lost(head.session, head.next_seq, None, head.cut)
                self.ready.append(lost)
            self.sessions.leave(head)
