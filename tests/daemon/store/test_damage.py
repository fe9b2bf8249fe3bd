"""Damage of every kind: no altered point is sent, none is missing unreported."""

import asyncio
import contextlib
import os
import random
import shutil
import sqlite3

import pytest

from tests.daemon.store.outbox_entries import DAY_NS, execute, rows
from tests.daemon.store.outbox_harness import OutboxOnLoop
from tests.end_to_end.programs import until
from tests.protocol.message_examples import POINT
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.outbox import message_of
from traverse.daemon.store.queries import (
    COLUMNS,
    iter_messages,
    open_read_only,
    stored_message,
)

N = 40
SESSION = "0123456789abcdef"


def point(seq):
    return POINT.model_copy(
        update={"session": SESSION, "seq": seq, "id": f"{SESSION}-{seq:05d}"}
    )


def message(seq):
    return message_of(point(seq), "traverse/bench-7/point", "msgpack", 1, "note")


ORIGINALS = [message(seq).payload for seq in range(N)]


def make(path, n=N):
    """A database as a daemon leaves it that has ended in order."""
    store = MessageDatabase(path)
    store.add([message(seq) for seq in range(n)])
    store.close()


async def sent_by(bench, n=N, patience_s=20.0):
    """Payloads that are sent, until so many are, or nothing more is reported."""
    sent = []
    end_s = asyncio.get_running_loop().time() + patience_s
    while len(sent) < n and asyncio.get_running_loop().time() < end_s:
        while (taken := bench.queue.next()) is not None:
            sent.append(taken[1].payload)
            bench.queue.done(*taken)
        bench.outbox.poll()
        await asyncio.sleep(0.01)
        if len(sent) + n_reported(bench) >= n and bench.occurrences:
            break
    return sent


def n_reported(bench):
    return sum(o.count for o in bench.occurrences if o.code == "outbox.damaged")


@pytest.mark.parametrize("column", COLUMNS.split(", ")[:7])
@pytest.mark.parametrize("value", ["CAST(x'ff41' AS TEXT)", "x'00ff'", "2.5", "-1"])
async def test_a_damaged_row_is_set_aside_by_itself(tmp_path, column, value):
    bench = OutboxOnLoop(tmp_path)
    make(bench.path)
    execute(bench.path, f"UPDATE messages SET {column} = {value} WHERE number = 18")
    async with bench.outbox.running():
        assert await sent_by(bench) == ORIGINALS[:17] + ORIGINALS[18:]
        await until(lambda: bench.occurrences, "it is reported")
        assert bench.codes() == ["outbox.damaged"]
        keeping = bench.take()
        await until(lambda: keeping.is_settled, "another point")
        assert keeping.trouble is None
    # It stays where it is, and is neither sent nor reported again.
    sent = execute(bench.path, "SELECT sent FROM messages ORDER BY number")
    assert [value for (value,) in sent] == [1] * 17 + [2] + [1] * 22 + [0]
    again = OutboxOnLoop(tmp_path)
    async with again.outbox.running():
        await until(again.queue.next, "what is left")
        assert again.codes() == []


async def test_a_point_that_is_sent_again_is_checked_too(tmp_path):
    bench = OutboxOnLoop(tmp_path)
    make(bench.path)
    async with bench.outbox.running():
        await sent_by(bench)
        bench.outbox.poll()
        await until(lambda: rows(bench.path)[-1][2] == 1, "all are marked")
        execute(bench.path, "UPDATE messages SET payload = x'aa' WHERE seq IN (3, 4)")
        answer = await bench.resend(session=SESSION, from_seq=2, to_seq=6)
        assert answer["points"] == 5
        assert await bench.send_until(3) == [("resend", seq) for seq in (2, 5, 6)]
        await until(lambda: bench.occurrences, "it is reported")
        (event,) = bench.occurrences
        assert (event.code, event.count) == ("outbox.damaged", 2)
        assert f"seq 3 of session '{SESSION}', seq 4 of" in event.text
        # Who requests them now learns that they cannot be had.
        answer = await bench.resend(session=SESSION, from_seq=3, to_seq=4)
        assert (answer["points"], answer["first_seq"], answer["last_seq"]) == (0, 0, 39)


@pytest.mark.parametrize("seed", range(60))
async def test_a_bit_that_flips_anywhere_alters_no_point(tmp_path, seed):
    """What is not sent as it was is reported: by itself, or with the whole file."""
    bench = OutboxOnLoop(tmp_path)
    make(bench.path)
    content = bytearray(bench.path.read_bytes())
    where = random.Random(seed).randrange(100, len(content))  # the header is the file
    content[where] ^= 1 << seed % 8
    bench.path.write_bytes(content)
    async with bench.outbox.running():
        sent = await sent_by(bench, patience_s=1.5)
        assert set(sent) <= set(ORIGINALS)
        missing = len(set(ORIGINALS) - set(sent))
        if missing and not n_reported(bench):
            assert bench.codes() == ["outbox.replaced"]
            assert f"; {missing} more of those cannot be read" in (
                bench.occurrences[0].text
            )
        elif missing:
            assert n_reported(bench) == missing


async def test_a_damaged_row_is_deleted_in_its_time_though_no_index_has_it(tmp_path):
    bench = OutboxOnLoop(tmp_path, keep_days=1.0)
    make(bench.path)
    store = MessageDatabase(bench.path)
    store.mark_sent([(1, N)])
    store.close()
    content = bench.path.read_bytes()
    name = message(7).id.encode()
    # The row is stored after its indices: the last place is the row's.
    place = content.rindex(name, 0, content.rindex(ORIGINALS[7]))
    bench.path.write_bytes(content[:place] + b"\xff" + content[place + 1 :])
    bench.clock.offset_ns = message(0).time_ns + 10 * DAY_NS
    async with bench.outbox.running():
        bench.run_for_minutes()
        await until(lambda: not rows(bench.path), "old points are deleted")
        assert set(bench.codes()) <= {"outbox.removed"}


# -- files --------------------------------------------------------------------


def killed(folder):
    """The files of a daemon that was killed: most messages are in the log."""
    work = folder / "work"
    work.mkdir()
    store = MessageDatabase(work / "outbox.db")
    store.add([message(seq) for seq in range(10)])
    store.mark_sent([(1, 10)])
    store.connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
    for seq in range(10, 20):
        store.add([message(seq)])
    assert store.is_file_unchanged  # as the daemon looks every half second
    for path in work.iterdir():
        if not path.name.endswith("-shm"):
            shutil.copy(path, folder)
    store.close()


def cut(path):
    os.truncate(path, path.stat().st_size // 2)


def alter(path):
    content = bytearray(path.read_bytes())
    for place in range(1000, len(content), 5000):
        content[place] ^= 0x55
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("file", "harm", "said"),
    [
        ("outbox.db-wal", cut, "it lacks the last"),
        ("outbox.db-wal", alter, "it lacks the last 10 "),
        ("outbox.db-wal", os.unlink, "it lacks the last 10 "),
        ("outbox.db", os.unlink, "it lacks all "),
        ("outbox.db", lambda path: os.truncate(path, 0), "it lacks all "),
    ],
)
async def test_what_a_crash_has_left_and_somebody_has_harmed(
    tmp_path, file, harm, said
):
    killed(tmp_path)
    harm(tmp_path / file)
    bench = OutboxOnLoop(tmp_path)
    async with bench.outbox.running():
        await until(lambda: bench.occurrences, "it is reported")
        (event,) = bench.occurrences
        assert event.code == "outbox.replaced"
        assert said in event.text
        assert f"up to seq 19 of session '{SESSION}'" in event.text
        assert "of which the broker did not have" in event.text
        (keeping,) = await bench.take_all(1)
        assert keeping.trouble is None
    assert execute(bench.path, "SELECT max(number) FROM messages") == [(21,)]
    again = OutboxOnLoop(tmp_path)
    async with again.outbox.running():
        await again.take_all(1)
        assert again.codes() == []


async def test_a_crash_by_itself_is_no_loss(tmp_path):
    killed(tmp_path)
    bench = OutboxOnLoop(tmp_path)
    async with bench.outbox.running():
        assert await sent_by(bench, 10) == ORIGINALS[10:20]
        assert bench.codes() == []


@pytest.mark.parametrize(
    ("file", "harm"),
    [
        ("outbox.db-wal", os.unlink),
        ("outbox.db-wal", cut),
        ("outbox.db", os.unlink),
        ("outbox.db", lambda path: os.truncate(path, 0)),
        ("outbox.db", cut),
    ],
)
async def test_what_is_harmed_while_it_runs_is_noticed_and_unsent_points_stay(
    bench, file, harm
):
    await bench.take_all(5)
    await settled(bench)
    await bench.take_all(25)
    harm(bench.path.with_name(file))
    await until(lambda: "outbox.replaced" in bench.codes(), "it is noticed")
    await bench.take_all(2)
    seqs = [seq for kind, seq in await bench.send_until(32) if kind == "point"]
    assert sorted(set(seqs)) == [*range(32)]
    with contextlib.closing(open_read_only(bench.path)) as connection:
        kept = iter_messages(connection, bench.session.id, 0, 999)
        assert [m.seq for m in kept if m.is_whole] == [*range(32)]


async def settled(bench):
    """As after half a second: the file is written from the log."""
    done = asyncio.get_running_loop().create_future()
    bench.outbox._writer.query(MessageDatabase.trim_file, done.set_result)
    assert await done is None


# -- rights ------------------------------------------------------------------


def test_only_the_owner_may_read_it_whatever_the_umask(path):
    before = os.umask(0)
    try:
        store = MessageDatabase(path)
        store.add([message(0)])
        modes = {p.name: p.stat().st_mode & 0o777 for p in path.parent.iterdir()}
        path.chmod(0o644)
        store.close()
        MessageDatabase(path).close()
    finally:
        os.umask(before)
    assert modes == dict.fromkeys(
        ["outbox.db", "outbox.db-shm", "outbox.db-wal", "outbox.last"], 0o600
    )
    assert path.stat().st_mode & 0o777 == 0o600


def test_a_row_that_only_an_index_calls_unsent_ends_the_query(path):
    """The file is damaged then: the row cannot be removed from the index."""
    make(path, 3)
    execute(path, "UPDATE messages SET payload = x'00' WHERE number = 2")
    store = MessageDatabase(path)
    with pytest.raises(sqlite3.DatabaseError, match="index does not fit"):
        store.read(read_everything)
    store.close()


def read_everything(connection):
    """As a query would whose index is not taken back by setting a message aside."""
    rows = connection.execute(f"SELECT {COLUMNS} FROM messages")
    return [stored_message(row) for row in rows]
