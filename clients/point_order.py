"""Points brought into order, without gap and without repeat, from what a broker brings.

A broker brings points late, twice, or not at all (mosquitto forgets when it is killed).
What is missing in (session, seq) is asked for again from the arm's outbox; what that
holds no more is told as `Lost`. Sessions follow one another in the order in which they
began. No clock and no connection here: `clients.points` has them.

Law: what is handed on is in order of (session, seq), each number of a followed session
once, as a point or within a `Lost`. Only points of a session that was taken for
complete may come late, since that is better than never.
"""

from collections import OrderedDict, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from clients.following import Followed, Lost
from clients.results import HeldSession, Resent
from protocol.messages import Point

BATCH = 500
"""Points asked for at once; brokers keep 1000 for a client that is slow."""
MAX_HELD = 2000
MAX_PAST = 2000
NEVER_FOLLOWED = -1
FORGOTTEN = "the arm's outbox holds them no more"
UNKNOWN = "the arm's outbox does not know this session any more"


@dataclass(frozen=True, slots=True)
class Ask:
    """What is to be asked of the outbox.

    Attributes:
        session: None asks which sessions there are.
        from_seq, to_seq: the range.
        is_tail: nobody knows whether there are such points.
    """

    session: str | None
    from_seq: int = 0
    to_seq: int = 0
    is_tail: bool = False


class PointOrder:
    """Takes points as they come; `ready` holds those whose turn it is.

    Args:
        since: next numbers of sessions that were followed before; None begins with the
            points of from now on, an empty map with everything that the outbox holds.

    Attributes:
        anchor: the arm's session when following began, where `since` is None.
        must_list: whether it has to be asked which sessions there are.
        ready: points and losses in their order, to be taken from the left.
        duplicates: points that came once more.
        start: next numbers of the sessions where following began.
        n_taken: points that came, whatever became of them.
        put_back: points for which there was no room; they are asked for again.
        asked: points that were asked for again.
    """

    def __init__(self, since: Mapping[str, int] | None) -> None:
        self._since = None if since is None else dict(since)
        self._sessions: dict[str, Followed] = {}
        self._past: OrderedDict[str, int] = OrderedDict()
        self._strangers: dict[str, dict[int, Point]] = {}
        self._refusal: str | None = None
        self.anchor: str | None = None
        self.has_begun = False
        self.must_list = True
        self.ready: deque[Point | Lost] = deque()
        self.start: dict[str, int] = dict(since or {})
        self.n_taken = 0
        self.duplicates = 0
        self.put_back = 0
        self.asked = 0

    @property
    def may_ask(self) -> bool:
        """Whether the arm sends points again, as far as is known."""
        return self._refusal is None

    @property
    def has_questions(self) -> bool:
        """Whether something may have to be asked for."""
        head = self._head()
        return self.may_ask and (
            self.must_list
            or (head is not None and (head.next_seq <= head.known or head.is_doubtful))
        )

    @property
    def place(self) -> dict[str, int]:
        """Next numbers of the sessions that are followed."""
        return {name: one.next_seq for name, one in self._sessions.items()}

    @property
    def n_held(self) -> int:
        """Points that came before their turn."""
        followed = sum(len(one.held) for one in self._sessions.values())
        return followed + sum(map(len, self._strangers.values()))

    def take(self, point: Point, *, room: bool = True) -> None:
        """A point has come; without room it only counts as seen."""
        self.n_taken += 1
        followed = self._sessions.get(point.session)
        if followed is None:
            self._take_strange(point)
            return
        if point.seq < followed.next_seq or point.seq in followed.held:
            self.duplicates += 1
            return
        followed.see(point.seq)
        is_next = followed is self._head() and point.seq == followed.next_seq
        if not room or (not is_next and self.n_held >= MAX_HELD):
            self.put_back += 1
            return
        followed.held[point.seq] = point
        if is_next or self._refusal is not None:
            self._hand_on()

    def notice(self, session: str) -> None:
        """The arm says that this is its session."""
        if session not in self._sessions and session not in self._past:
            self.must_list = True

    def may_ask_again(self) -> None:
        """There is a new connection: what was refused may be granted now."""
        self._refusal = None
        self.must_list = True

    def next_ask(self, room: int) -> Ask | None:
        """What is to be asked for now; None: nothing is known to be missing."""
        if self._refusal is not None:
            return None
        if self.must_list:
            return Ask(None)
        head = self._head()
        if head is None or room < 1:
            return None
        gap = head.missing()
        if gap is not None:
            first, last = gap
            return Ask(head.session, first, min(last, first + min(room, BATCH) - 1))
        return self.tail_ask() if head.is_doubtful else None

    def tail_ask(self) -> Ask:
        """Asks for what may have come after the last point that is known of."""
        head = self._head()
        if head is None:
            return Ask(None)
        first = head.next_seq
        return Ask(head.session, first, first + BATCH - 1, is_tail=True)

    def next_seq_of(self, session: str) -> int | None:
        """The number of a session that is handed on next; None: it is complete."""
        followed = self._sessions.get(session)
        return None if followed is None else followed.next_seq

    def resent(self, ask: Ask, answer: Resent) -> int | None:
        """The outbox has answered.

        Returns:
            The last number that it will send; None where it sends none.
        """
        self.asked += answer.points
        head = self._head()
        if head is None or head.session != ask.session:
            return None
        first, last = answer.first_seq, answer.last_seq
        if head.is_doubtful:
            head.is_doubtful, head.has_ended = False, True
            head.is_cut = last is None
        if last is not None:
            head.see(last)
        if first is None or last is None or last < ask.from_seq:
            if not ask.is_tail and ask.to_seq >= head.next_seq:
                self.ready.append(head.give_up(ask.to_seq, FORGOTTEN))
            self._hand_on()
            return None
        if first > head.next_seq:
            self.ready.append(head.give_up(first - 1, FORGOTTEN))
        self._hand_on()
        return min(last, ask.to_seq)

    def refuse(self, reason: str) -> None:
        """The arm cannot send points again: go on with what comes, and tell gaps."""
        self._refusal = reason
        self.must_list = False
        first_time, self.has_begun = not self.has_begun, True
        if first_time:
            for session, next_seq in (self._since or {}).items():
                self._sessions[session] = Followed(session, 0, next_seq)
        self._adopt_strangers(from_first=first_time and self._since is None)
        self._hand_on()

    def listed(self, sessions: Sequence[HeldSession]) -> None:
        """The outbox has told which sessions it holds, oldest first."""
        self.must_list = False
        if not self.has_begun:
            self.has_begun = True
            self._begin(sessions)
            self.start = self.start or self.place
        names = [one.session for one in sessions]
        for one in sessions:
            self._note(one)
        for name, followed in list(self._sessions.items()):
            if name in names:
                followed.has_ended = followed.has_ended or name != names[-1]
            elif followed.known < 0:
                del self._sessions[name]  # it had no points, and says nothing
            elif not followed.has_ended:
                followed.is_doubtful = True
        self._adopt_strangers()
        self._hand_on()

    def _begin(self, sessions: Sequence[HeldSession]) -> None:
        """Say where following begins: what is before that is past."""
        names = [one.session for one in sessions]
        if self._since is None:
            self._begin_now(sessions, names)
            return
        start = max((names.index(s) for s in self._since if s in names), default=0)
        for name in names[:start]:
            self._passed(name, NEVER_FOLLOWED)
        if self._since and not set(names) & set(self._since):
            newest, next_seq = list(self._since.items())[-1]
            self._sessions[newest] = Followed(newest, 0, next_seq)

    def _begin_now(self, sessions: Sequence[HeldSession], names: list[str]) -> None:
        if not names:
            return
        anchor = self.anchor if self.anchor in names else names[-1]
        for name in names[: names.index(anchor)]:
            self._passed(name, NEVER_FOLLOWED)
        held = sessions[names.index(anchor)]
        next_seq = 0 if held.last_seq is None else held.last_seq + 1
        next_seq = min([next_seq, *self._strangers.get(anchor, {})])
        self._sessions[anchor] = Followed(anchor, held.begun_ns, next_seq)

    def _note(self, one: HeldSession) -> None:
        if one.session in self._past:
            return
        followed = self._sessions.get(one.session)
        if followed is None:
            next_seq = (self._since or {}).get(one.session, 0)
            followed = Followed(one.session, one.begun_ns, next_seq)
            self._sessions[one.session] = followed
        followed.begun_ns = one.begun_ns
        if one.last_seq is not None:
            followed.see(one.last_seq)

    def _take_strange(self, point: Point) -> None:
        past = self._past.get(point.session)
        held = self._strangers.get(point.session, {})
        if (
            past is not None and (past == NEVER_FOLLOWED or point.seq < past)
        ) or point.seq in held:
            self.duplicates += 1
        elif self.n_held >= MAX_HELD:
            self.put_back += 1
            self.must_list = True
        else:
            self._strangers[point.session] = {**held, point.seq: point}
            self.must_list = True
            if self._refusal is not None:
                self.refuse(self._refusal)

    def _adopt_strangers(self, *, from_first: bool = False) -> None:
        """Sort in the points that waited for the list of sessions."""
        strangers, self._strangers = self._strangers, {}
        for session, held in strangers.items():
            followed = self._sessions.get(session)
            if followed is None:
                past = self._past.get(session)
                if past == NEVER_FOLLOWED:
                    self.duplicates += len(held)
                    continue
                first = min(held) if from_first else past or 0
                followed = Followed(session, held[min(held)].time_ns, first)
                followed.has_ended = self._refusal is None
                self._insert(followed)
            for seq, point in held.items():
                followed.see(seq)
                if seq < followed.next_seq:
                    self.duplicates += 1
                else:
                    followed.held[seq] = point

    def _insert(self, followed: Followed) -> None:
        """Put a session that is in no list where it belongs by its time."""
        sessions = list(self._sessions.values())
        at = len(sessions)
        while at and sessions[at - 1].begun_ns > followed.begun_ns:
            at -= 1
        sessions.insert(at, followed)
        self._sessions = {one.session: one for one in sessions}

    def _head(self) -> Followed | None:
        return next(iter(self._sessions.values()), None)

    def _hand_on(self) -> None:
        """Make ready what can be, session by session."""
        while (head := self._head()) is not None:
            self.ready.extend(head.run())
            if self._refusal is not None:
                while (gap := head.missing()) is not None:
                    self.ready.append(head.give_up(gap[1], self._refusal))
                    self.ready.extend(head.run())
                head.has_ended = len(self._sessions) > 1
            if not head.is_complete:
                return
            if head.is_cut:
                lost = Lost(head.session, head.next_seq, None, UNKNOWN)
                self.ready.append(lost)
            self._passed(head.session, head.next_seq)
            del self._sessions[head.session]

    def _passed(self, session: str, next_seq: int) -> None:
        self._past[session] = next_seq
        while len(self._past) > MAX_PAST:
            self._past.popitem(last=False)
