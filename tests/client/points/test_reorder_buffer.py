"""The order of points, beside a model of an outbox and of a broker that loses."""

import random
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.protocol.message_examples import POINT
from traverse.client.points.reorder_buffer import UNKNOWN, ReorderBuffer, ResendRequest
from traverse.client.points.session_order import FORGOTTEN, Lost
from traverse.client.results import Resent, StoredSession
from traverse.protocol.messages import Point

ROOM = 10_000


def point(session: str, seq: int) -> Point:
    changed = {"session": session, "seq": seq, "id": f"{session}-{seq}"}
    return POINT.model_copy(update=changed)


class Outbox:
    """Points of an arm: all that were taken, and those still held."""

    def __init__(self) -> None:
        self.sessions: dict[str, range] = {}
        self.damaged: set[tuple[str, int]] = set()

    def begin(self) -> str:
        session = f"s{len(self.sessions)}"
        self.sessions[session] = range(0)
        return session

    def add(self, session: str) -> Point:
        held = self.sessions[session]
        self.sessions[session] = range(held.start, held.stop + 1)
        return point(session, held.stop)

    def forget(self, session: str, below: int) -> None:
        held = self.sessions[session]
        self.sessions[session] = range(min(below, held.stop), held.stop)

    def listed(self) -> list[StoredSession]:
        return [self._held(held) for held in self.sessions]

    def answer(self, ask: ResendRequest) -> tuple[Resent, list[Point]]:
        session = ask.session or ""
        held = self.sessions.get(session, range(0))
        sent = [
            point(session, i)
            for i in held
            if ask.from_seq <= i <= ask.to_seq and (session, i) not in self.damaged
        ]
        first, last = (held[0], held[-1]) if held else (None, None)
        held = Resent(session=session, points=len(sent), first_seq=first, last_seq=last)
        return held, sent

    def _held(self, session: str) -> StoredSession:
        held = self.sessions[session]
        first, last = (held[0], held[-1]) if held else (None, None)
        return StoredSession(
            session=session, begun_ns=int(session[1:]), first_seq=first, last_seq=last
        )


def settle(order: ReorderBuffer, outbox: Outbox, lose: Callable[[], bool]) -> None:
    """Carry out requests until there are none; lose some points."""
    for _ in range(10_000):
        ask = order.next_request(ROOM)
        if ask is None:
            return
        if ask.session is None:
            order.listed(outbox.listed())
            continue
        answer, sent = outbox.answer(ask)
        order.resent(ask, answer)
        for point in sent:
            if not lose():
                order.take(point)
    raise AssertionError("it asks for ever")


def never() -> bool:
    return False


def numbers(order: ReorderBuffer) -> list[tuple[str, int]]:
    numbers = []
    for item in order.ready:
        if isinstance(item, Point):
            numbers.append((item.session, item.seq))
        elif item.to_seq is not None:
            lost = range(item.from_seq, item.to_seq + 1)
            numbers += [(item.session, seq) for seq in lost]
    return numbers


def started(since: dict[str, int] | None = None) -> tuple[ReorderBuffer, Outbox, str]:
    outbox = Outbox()
    session = outbox.begin()
    order = ReorderBuffer(since)
    settle(order, outbox, never)
    return order, outbox, session


@given(st.integers(0, 2**32), st.floats(0.0, 0.6), st.floats(0.0, 0.1))
def test_every_number_is_handed_on_once_and_in_order_whatever_a_broker_loses(
    seed: int, loss: float, forgetting: float
) -> None:
    chance = random.Random(seed)
    order, outbox, session = started({})

    def lose() -> bool:
        return chance.random() < loss

    late: list[Point] = []
    for _ in range(chance.randrange(200)):
        draw = chance.random()
        if draw < 0.05:
            session = outbox.begin()
            if not lose():
                order.notice(session)
        elif draw < 0.05 + forgetting:
            old = chance.choice(list(outbox.sessions))
            held = outbox.sessions[old]  # the newest stays: else it would be unknown
            below = min(held.start + chance.randrange(5), held.stop - 1)
            outbox.forget(old, max(below, held.start))
        elif draw < 0.2 and outbox.sessions[session]:
            outbox.damaged.add((session, chance.choice(outbox.sessions[session])))
        elif draw < 0.25:
            order.connection_restored()
            sessions = outbox.listed() if order.next_request(ROOM) else []
            session = outbox.begin() if lose() else session
            for _ in range(chance.randrange(3)):  # while the answer is on its way
                order.take(outbox.add(session))
            order.listed(sessions)
            settle(order, outbox, lose)
        else:
            added = outbox.add(session)
            for copy in range(chance.choice((1, 1, 1, 2))):
                is_late = chance.random() < 0.1 + copy / 2
                if not lose():
                    (late.append if is_late else order.take)(added)
            if late and chance.random() < 0.3:
                order.take(late.pop(chance.randrange(len(late))))
    for point in late:
        order.take(point)
    order.connection_restored()
    settle(order, outbox, never)
    expected = [(s, i) for s, held in outbox.sessions.items() for i in range(held.stop)]
    assert numbers(order) == expected
    held_yet = {(s, i) for s, held in outbox.sessions.items() for i in held}
    held_yet -= outbox.damaged
    lost = {
        (item.session, i)
        for item in order.ready
        if isinstance(item, Lost)
        for i in range(item.from_seq, (item.to_seq or 0) + 1)
    }
    assert not lost & held_yet


def test_a_gap_is_requested_and_what_came_early_waits() -> None:
    order, _, session = started()
    order.take(point(session, 0))
    order.take(point(session, 3))
    assert numbers(order) == [(session, 0)]
    assert order.next_request(ROOM) == ResendRequest(session, 1, 2)
    order.take(point(session, 1))
    order.take(point(session, 2))
    assert numbers(order) == [(session, i) for i in range(4)]
    assert order.next_request(ROOM) is None


def test_large_gaps_are_requested_in_pieces_and_only_as_there_is_room() -> None:
    order, _, session = started()
    order.take(point(session, 2000))
    assert order.next_request(ROOM) == ResendRequest(session, 0, 499)
    assert order.next_request(10) == ResendRequest(session, 0, 9)
    assert order.next_request(0) is None


def test_now_begins_after_what_the_outbox_holds() -> None:
    outbox = Outbox()
    old, new = outbox.begin(), outbox.begin()
    for session in (old, old, new, new, new):
        outbox.add(session)
    order = ReorderBuffer(None)
    order.notice(new)
    settle(order, outbox, never)
    order.take(point(old, 1))  # another client has requested it
    order.take(point(new, 2))
    order.take(outbox.add(new))
    assert numbers(order) == [(new, 3)]
    assert order.duplicates == 2
    assert order.sessions.start == {new: 3}


def test_sessions_after_the_one_at_the_beginning_come_whole() -> None:
    outbox = Outbox()
    old = outbox.begin()
    outbox.add(old)
    order = ReorderBuffer(None)
    order.notice(old)  # the daemon was away; the session is over by now
    middle, new = outbox.begin(), outbox.begin()
    for session in (middle, middle, new):
        outbox.add(session)
    settle(order, outbox, never)
    assert numbers(order) == [(middle, 0), (middle, 1), (new, 0)]


def test_a_place_continues_where_it_stopped() -> None:
    outbox = Outbox()
    sessions = [outbox.begin() for _ in range(3)]
    for session in sessions:
        for _ in range(3):
            outbox.add(session)
    order = ReorderBuffer({sessions[1]: 1})
    settle(order, outbox, never)
    _, second, third = sessions
    expected = [(second, 1), (second, 2), (third, 0), (third, 1), (third, 2)]
    assert numbers(order) == expected


def test_what_retention_has_taken_is_reported_as_lost() -> None:
    order, outbox, session = started()
    for _ in range(10):
        outbox.add(session)
    outbox.forget(session, 4)
    order.connection_restored()
    settle(order, outbox, never)
    assert order.ready[0] == Lost(session, 0, 3, FORGOTTEN)
    assert numbers(order) == [(session, i) for i in range(10)]


def test_a_session_that_the_outbox_does_not_know_any_more_is_reported() -> None:
    order, outbox, session = started()
    order.take(outbox.add(session))
    another = Outbox()  # the database was set aside
    another.begin()
    fresh = another.begin()
    another.sessions.pop("s0")
    order.connection_restored()
    settle(order, another, never)
    order.take(another.add(fresh))
    assert list(order.ready) == [
        point(session, 0),
        Lost(session, 1, None, UNKNOWN),
        point(fresh, 0),
    ]


def test_a_session_of_which_nothing_is_left_is_reported() -> None:
    order, outbox, session = started()
    order.take(outbox.add(session))
    outbox.add(session)
    outbox.forget(session, 2)
    outbox.begin()
    order.connection_restored()
    settle(order, outbox, never)
    assert list(order.ready)[1:] == [Lost(session, 1, None, FORGOTTEN)]


def test_an_empty_session_that_is_in_no_list_says_nothing() -> None:
    order, _, session = started()
    order.connection_restored()
    assert order.next_request(ROOM) == ResendRequest(None)
    order.listed([])
    assert order.next_request(ROOM) is None
    order.take(point(session, 0))
    assert order.next_request(ROOM) == ResendRequest(None)


def test_an_arm_that_cannot_send_again_has_its_gaps_told() -> None:
    order = ReorderBuffer(None)
    order.take(point("a", 5))
    order.refuse("no")
    for session, seq in (("a", 6), ("a", 9), ("b", 1), ("b", 1)):
        order.take(point(session, seq))
    assert list(order.ready) == [
        point("a", 5),
        point("a", 6),
        Lost("a", 7, 8, "no"),
        point("a", 9),
        Lost("b", 0, 0, "no"),
        point("b", 1),
    ]
    assert order.next_request(ROOM) is None
    order.connection_restored()
    assert order.next_request(ROOM) == ResendRequest(None)


def test_points_without_room_are_requested_later() -> None:
    order, outbox, session = started()
    points = [outbox.add(session) for _ in range(5)]
    order.take(points[0])
    for point in points[1:]:
        order.take(point, room=False)
    assert numbers(order) == [(session, 0)]
    settle(order, outbox, never)
    assert numbers(order) == [(session, i) for i in range(5)]


@pytest.mark.parametrize("n", [5000])
def test_what_waits_for_its_turn_is_bounded(n: int) -> None:
    order, outbox, session = started()
    points = [outbox.add(session) for _ in range(n)]
    for point in points[1:]:
        order.take(point)
    assert order.n_held <= 2000
    settle(order, outbox, never)
    assert numbers(order) == [(session, i) for i in range(n)]


def test_points_of_a_session_taken_for_complete_come_late_rather_than_never() -> None:
    order, outbox, session = started()
    order.take(outbox.add(session))
    fresh = outbox.begin()
    order.notice(fresh)
    settle(order, outbox, never)
    order.take(outbox.add(fresh))
    order.take(outbox.add(session))
    settle(order, outbox, never)
    assert numbers(order) == [(session, 0), (fresh, 0), (session, 1)]
