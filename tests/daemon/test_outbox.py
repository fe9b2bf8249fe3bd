"""The outbox on the event loop, with its thread and a real database."""

import contextlib
import sqlite3
import threading

import pytest

from daemon.commands import CommandError
from daemon.events import EventLog
from daemon.health import HealthReport
from daemon.outbox import Outbox
from daemon.outbox_feed import TOGETHER
from daemon.outbox_resend import MAX_RANGES
from daemon.outbox_section import OutboxSection
from daemon.outbox_values import OutboxRefusedError
from daemon.outgoing import MAX_POINTS, OutgoingQueue
from daemon.sessions import Session
from protocol.encoding import decode
from protocol.messages import Point, ResendArgs
from tests.daemon.outbox_bench import entries, execute, rows
from tests.daemon.values import SetClock
from tests.end_to_end.programs import until
from tests.protocol.message_examples import POINT

FULL = (
    "CREATE TRIGGER {0}_full BEFORE INSERT ON {0} "
    "BEGIN SELECT RAISE(FAIL, 'database or disk is full'); END"
)


class Bench:
    """An outbox in a folder; points are numbered as `Capture` does."""

    def __init__(self, folder, limit=10_000, **section):
        self.path = folder / "outbox.db"
        self.queue = OutgoingQueue()
        self.occurrences = []
        self.clock = SetClock()
        self.session = Session(1, "note")
        self.statuses = []
        self.health = HealthReport(self.clock)
        self.outbox = Outbox(
            self.path,
            arm="bench-7",
            encoding="msgpack",
            clock=self.clock,
            section=OutboxSection(**section),
            limit=limit,
            session=lambda: self.session.id,
            queue=self.queue,
            events=EventLog(self.clock, self.occurrences.append),
            latencies=self.health.latencies,
            changed=lambda: self.statuses.append(self.outbox.is_ready),
        )

    def take(self):
        """A point as `Capture` hands it on; None where there is no room."""
        session = self.session
        point = POINT.model_copy(
            update={
                "session": session.id,
                "seq": session.next_seq,
                "id": session.next_id,
            }
        )
        keeping = self.outbox.keep(session, point)
        if keeping is not None:
            session.add(point)
        return keeping

    async def take_all(self, n):
        keepings = [self.take() for _ in range(n)]
        await until(lambda: all(k.is_settled for k in keepings), "they are settled")
        return keepings

    def send(self, n=10**6):
        """Be the broker, which takes so many; gives their payloads as messages."""
        sent = []
        while len(sent) < n and (taken := self.queue.next()) is not None:
            self.queue.done(*taken)
            if taken[0] in ("point", "resend"):
                sent.append((taken[0], decode(Point, taken[1].payload).seq))
        return sent

    async def send_until(self, n):
        sent = []

        def there() -> bool:
            sent.extend(self.send())
            return len(sent) >= n

        await until(there, f"{n} messages, so far {len(sent)}")
        return sent

    def codes(self, active=None):
        return [o.code for o in self.occurrences if o.active is active]


@pytest.fixture
async def bench(tmp_path):
    bench = Bench(tmp_path)
    async with bench.outbox.running():
        yield bench


def numbers(kind, *values):
    return [(kind, value) for value in values]


async def test_a_point_is_on_the_disk_before_anybody_hears_of_it(bench):
    keeping = bench.take()
    heard = []
    keeping.when_settled(lambda: heard.append(rows(bench.path)))
    assert not keeping.is_settled
    assert bench.queue.next() is None
    await until(lambda: heard, "it is settled")
    assert heard == [[(bench.session.id, 0, 0)]]
    assert keeping.trouble is None
    assert bench.send() == numbers("point", 0)


async def test_what_the_broker_has_is_marked_and_nothing_else(bench):
    await bench.take_all(3)
    assert bench.send(2) == numbers("point", 0, 1)
    bench.outbox.keep_house()

    def sent():
        return [row[2] for row in rows(bench.path)]

    await until(lambda: sent() == [1, 1, 0], "two are marked")
    await until(lambda: bench.outbox.health().unsent == 1, "health knows")
    assert bench.outbox.health().points == 3
    assert bench.outbox.health().oldest_unsent_ns == POINT.time_ns


async def test_points_in_flight_share_commits_and_keep_their_order(bench):
    keepings = await bench.take_all(500)
    assert [k.point.seq for k in keepings] == [*range(500)]
    assert [row[1] for row in rows(bench.path)] == [*range(500)]
    assert bench.send() == numbers("point", *range(500))
    taken = bench.health.latencies["point_to_disk"]
    assert taken.figures().n == 500


async def test_beyond_what_may_be_in_flight_no_point_is_taken(tmp_path):
    bench = Bench(tmp_path, limit=2)
    async with bench.outbox.running():
        keepings = [bench.take() for _ in range(3)]
        assert keepings[2] is None
        await until(lambda: keepings[1].is_settled, "room")
        assert (await bench.take_all(1))[0].point.seq == 2
    assert bench.take() is None  # it is closed


async def test_what_a_run_has_left_is_sent_first_by_the_next(tmp_path):
    first = Bench(tmp_path)
    async with first.outbox.running():
        await first.take_all(3)
        first.send(1)
    second = Bench(tmp_path)
    async with second.outbox.running():
        keeping = second.take()
        await until(lambda: keeping.is_settled, "a new one")
        assert await second.send_until(3) == numbers("point", 1, 2, 0)
    assert [row[2] for row in rows(second.path)] == [1, 1, 1, 1]


async def test_a_broker_that_is_away_costs_disk_and_no_memory(bench):
    n = 3 * MAX_POINTS
    await bench.take_all(n)
    assert bench.queue.waiting("point") == MAX_POINTS
    assert await bench.send_until(n) == numbers("point", *range(n))
    await bench.take_all(2)
    assert bench.send() == numbers("point", n, n + 1)  # from memory again
    bench.outbox.keep_house()
    await until(lambda: bench.outbox.health().unsent == 0, "all are marked")


async def test_points_that_come_while_others_are_read_keep_the_order(bench):
    await bench.take_all(MAX_POINTS + 5 * TOGETHER)
    sent = []
    for _ in range(40):
        sent += bench.send(50)
        await bench.take_all(3)
    sent += await bench.send_until(bench.session.next_seq - len(sent))
    assert sent == numbers("point", *range(bench.session.next_seq))


# -- a disk that fails --------------------------------------------------------


async def test_a_commit_that_fails_gives_the_numbers_back(bench):
    await bench.take_all(2)
    for table in ("messages", "room"):
        execute(bench.path, FULL.format(table))
    keepings = await bench.take_all(3)
    assert all("database or disk is full" in k.trouble.text for k in keepings)
    assert bench.session.next_seq == 2
    await until(lambda: bench.codes(True), "it is told")
    assert bench.codes(True) == ["outbox.failed"]
    assert (bench.statuses, bench.outbox.health().state) == ([False], "failed")
    assert [k.trouble is None for k in await bench.take_all(1)] == [False]
    for table in ("messages", "room"):
        execute(bench.path, f"DROP TRIGGER {table}_full")
    await until(lambda: bench.outbox.is_ready, "it goes on by itself")
    assert bench.codes(False) == ["outbox.failed"]
    (keeping,) = await bench.take_all(1)
    assert (keeping.trouble, keeping.point.seq) == (None, 2)
    assert bench.send() == numbers("point", 0, 1, 2)


async def test_points_behind_a_failed_one_fail_until_the_loop_has_heard(bench):
    """Numbers must not follow on numbers that nobody has."""
    await bench.take_all(1)
    execute(bench.path, FULL.format("messages"))
    first, has_failed = bench.take(), threading.Event()
    bench.outbox._ask(lambda store: has_failed.set(), lambda _: None)
    assert has_failed.wait(20.0)  # and the loop stands: it has not heard of it
    execute(bench.path, "DROP TRIGGER messages_full")
    second = bench.take()
    await until(lambda: second.is_settled, "both are settled")
    assert (first.point.seq, second.point.seq) == (1, 2)
    assert first.trouble is second.trouble
    assert first.trouble is not None
    assert (await bench.take_all(1))[0].point.seq == 1
    assert [row[1] for row in rows(bench.path)] == [0, 1]


async def test_marks_that_cannot_be_written_are_written_later(bench):
    await bench.take_all(2)
    execute(
        bench.path,
        "CREATE TRIGGER no_marks BEFORE UPDATE ON messages "
        "BEGIN SELECT RAISE(FAIL, 'disk I/O error'); END",
    )
    bench.send()
    bench.outbox.keep_house()
    await until(lambda: bench.codes(True), "it is told")
    bench.outbox.keep_house()
    execute(bench.path, "DROP TRIGGER no_marks")

    def are_marked() -> bool:
        bench.outbox.keep_house()
        return [row[2] for row in rows(bench.path)] == [1, 1]

    await until(are_marked, "the marks are there")


async def test_a_damaged_file_is_set_aside_and_measuring_goes_on(tmp_path):
    (tmp_path / "outbox.db").write_bytes(b"no database at all" * 1000)
    bench = Bench(tmp_path)
    async with bench.outbox.running():
        (keeping,) = await bench.take_all(1)
        assert keeping.trouble is None
        assert bench.codes() == ["outbox.replaced"]
        assert "corrupt-" in bench.occurrences[0].text
    (aside,) = tmp_path.glob("outbox.db.corrupt-*")
    assert aside.read_bytes().startswith(b"no database at all")


async def test_unsent_points_of_a_damaged_file_are_taken_over(tmp_path):
    first = Bench(tmp_path)
    async with first.outbox.running():
        await first.take_all(60)
        first.send(20)
    damage(first.path)
    second = Bench(tmp_path)
    async with second.outbox.running():
        keeping = second.take()
        await until(lambda: keeping.is_settled, "a new one")
        assert await second.send_until(41) == numbers("point", *range(20, 60), 0)
        (told,) = second.occurrences
        assert told.code == "outbox.replaced"
        assert "with 40 points that had not been sent" in told.text
        answer = await second.outbox.resend(ResendArgs())
        assert [s["begun_ns"] for s in answer["sessions"]] == ["1", "1"]
        assert answer["sessions"][0]["first_seq"] == 20


async def test_damage_while_it_runs_loses_no_number(bench):
    """Points that had been kept go on to the broker; new ones go to a new file."""
    await bench.take_all(30)
    bench.outbox._ask(
        lambda store: store.connection.execute("PRAGMA wal_checkpoint(TRUNCATE)"),
        lambda _: damage(bench.path),
    )
    await until(lambda: "outbox.replaced" in _after_a_point(bench), "it is noticed")
    n = bench.session.next_seq
    await bench.outbox.idle()
    sent = {seq for _, seq in await bench.send_until(n)}
    assert sent == set(range(n))


def _after_a_point(bench):
    bench.take()
    return bench.codes()


def damage(path):
    """Overwrite the first rows, and the pages of an index, but not the header."""
    content = bytearray(path.read_bytes())
    tables = sqlite3.connect(path)
    (root,) = tables.execute(
        "SELECT rootpage FROM sqlite_master WHERE name = 'sqlite_autoindex_messages_1'"
    ).fetchone()
    tables.close()
    content[(root - 1) * 4096 : (root - 1) * 4096 + 64] = b"\xa5" * 64
    path.write_bytes(content)


async def test_a_file_that_is_removed_is_replaced_and_numbers_go_on(bench):
    await bench.take_all(3)
    for end in ("", "-wal", "-shm"):
        with contextlib.suppress(FileNotFoundError):
            bench.path.with_name(f"outbox.db{end}").unlink()
    await until(lambda: "outbox.replaced" in bench.codes(), "it is noticed")
    await bench.take_all(2)
    assert [row[1] for row in rows(bench.path)] == [3, 4]
    bench.send()
    bench.outbox.keep_house()
    await until(
        lambda: [row[2] for row in rows(bench.path)] == [1, 1], "marks fit the new one"
    )


async def test_a_newer_file_is_refused_at_the_start(tmp_path):
    bench = Bench(tmp_path)
    async with bench.outbox.running():
        await bench.take_all(1)
    execute(bench.path, "PRAGMA user_version = 9")
    with pytest.raises(OutboxRefusedError, match="version 9"):
        async with Bench(tmp_path).outbox.running():
            pass


async def test_two_daemons_do_not_share_a_state_folder(bench, tmp_path):
    with pytest.raises(OutboxRefusedError, match="another daemon uses"):
        async with Bench(tmp_path).outbox.running():
            pass
    assert (await bench.take_all(1))[0].trouble is None


async def test_a_state_folder_that_cannot_be_had_is_refused(tmp_path):
    (tmp_path / "state").write_text("a file")
    with pytest.raises(OutboxRefusedError, match="STATE_DIRECTORY"):
        async with Bench(tmp_path / "state").outbox.running():
            pass


async def test_a_lock_of_another_program_refuses_points_until_it_is_gone(bench):
    await bench.take_all(1)
    other = sqlite3.connect(bench.path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    (keeping,) = await bench.take_all(1)
    assert "another program holds the database" in keeping.trouble.text
    other.execute("ROLLBACK")
    other.close()
    await until(lambda: bench.outbox.is_ready, "it goes on")


# -- resend -------------------------------------------------------------------


async def test_a_range_is_sent_again_with_the_same_bytes_behind_new_ones(bench):
    await bench.take_all(6)
    bench.send()
    answer = await bench.outbox.resend(
        ResendArgs(session=bench.session.id, from_seq=2, to_seq=4)
    )
    assert answer == {
        "session": bench.session.id,
        "from_seq": 2,
        "to_seq": 4,
        "points": 3,
        "first_seq": 0,
        "last_seq": 5,
    }
    await until(lambda: bench.queue.waiting("resend") == 3, "they are read")
    await bench.take_all(1)
    assert bench.send() == [*numbers("point", 6), *numbers("resend", 2, 3, 4)]


async def test_all_of_a_session_comes_again_a_bounded_number_at_a_time(bench):
    await bench.take_all(700)
    bench.send()
    answer = await bench.outbox.resend(ResendArgs(session=bench.session.id))
    assert (answer["points"], answer["to_seq"], answer["last_seq"]) == (700, None, 699)
    most, sent = 0, []

    def there() -> bool:
        nonlocal most
        most = max(most, bench.queue.waiting("resend"))
        sent.extend(bench.send(20))
        return len(sent) == 700

    await until(there, "all of them")
    assert sent == numbers("resend", *range(700))
    assert most <= 100


async def test_an_unknown_session_is_answered_with_nothing(bench):
    await bench.take_all(1)
    answer = await bench.outbox.resend(ResendArgs(session="nobody", from_seq=3))
    assert (answer["points"], answer["first_seq"], answer["last_seq"]) == (
        0,
        None,
        None,
    )


async def test_without_a_session_it_tells_which_there_are(tmp_path):
    sessions = []
    for n in (2, 3):
        bench = Bench(tmp_path)
        async with bench.outbox.running():
            await bench.take_all(n)
            sessions.append(bench.session.id)
            answer = await bench.outbox.resend(ResendArgs())
    assert answer["sessions"] == [
        {"session": sessions[0], "begun_ns": "1", "first_seq": 0, "last_seq": 1},
        {"session": sessions[1], "begun_ns": "1", "first_seq": 0, "last_seq": 2},
    ]


async def test_too_many_ranges_at_once_are_refused_with_what_to_do(bench):
    await bench.take_all(200)
    bench.send()
    again = ResendArgs(session=bench.session.id)
    for _ in range(MAX_RANGES):
        await bench.outbox.resend(again)
    with pytest.raises(CommandError, match="ranges are being sent") as caught:
        await bench.outbox.resend(again)
    assert caught.value.code == "resend.busy"
    await bench.send_until(1000)


# -- retention ----------------------------------------------------------------


async def test_old_points_go_by_themselves_and_the_unsent_stay(tmp_path):
    bench = Bench(tmp_path, keep_days=1.0)
    async with bench.outbox.running():
        old = [*entries("old", 3, time_ns=5), *entries("left", 2, time_ns=5)]
        bench.outbox._ask(lambda store: store.add(old), lambda _: None)
        bench.outbox._ask(lambda store: store.mark_sent([(1, 3)]), lambda _: None)
        await until(
            lambda: [row[0] for row in rows(bench.path)] == ["left", "left"],
            "they are gone",
        )
