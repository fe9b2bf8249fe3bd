"""Disks that fail, files that are damaged, removed or of others: no number is lost."""

import asyncio
import contextlib
import os
import sqlite3
import threading

import pytest

from tests.daemon.store.outbox_entries import execute, fill_disk, make_room, rows
from tests.daemon.store.outbox_harness import OutboxOnLoop, numbers
from tests.end_to_end.programs import until
from traverse.daemon.store.records import DatabaseRefusedError
from traverse.daemon.store.recovery import storage_error_of


async def test_a_commit_that_fails_gives_the_numbers_back(bench):
    await bench.take_all(2)
    fill_disk(bench.path)
    keepings = await bench.take_all(3)
    assert all("database or disk is full" in k.trouble.text for k in keepings)
    assert bench.session.next_seq == 2
    await until(lambda: bench.codes(True), "it is reported")
    assert bench.codes(True) == ["outbox.failed"]
    assert (bench.statuses, bench.outbox.health().state) == ([False], "failed")
    assert [k.trouble is None for k in await bench.take_all(1)] == [False]
    make_room(bench.path)
    await until(lambda: bench.outbox.is_ready, "it goes on by itself")
    assert bench.codes(False) == ["outbox.failed"]
    (keeping,) = await bench.take_all(1)
    assert (keeping.trouble, keeping.point.seq) == (None, 2)
    assert bench.send() == numbers("point", 0, 1, 2)


async def test_points_behind_a_failed_one_fail_until_the_loop_has_heard(bench):
    """Numbers must not follow numbers that were never stored."""
    await bench.take_all(1)
    fill_disk(bench.path, "messages")
    first, has_failed = bench.take(), threading.Event()
    bench.outbox._writer.query(lambda store: has_failed.set(), lambda _: None)
    assert has_failed.wait(20.0)  # the loop is blocked: it is not yet notified
    make_room(bench.path)
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
    bench.outbox.poll()
    await until(lambda: bench.codes(True), "it is reported")
    bench.outbox.poll()
    execute(bench.path, "DROP TRIGGER no_marks")

    def are_marked() -> bool:
        bench.outbox.poll()
        return [row[2] for row in rows(bench.path)] == [1, 1]

    await until(are_marked, "the marks are there")


async def test_a_damaged_file_is_set_aside_and_measuring_continues(tmp_path):
    folder = tmp_path / os.fsdecode(b"gr\xf6\xdfe")  # no UTF-8
    folder.mkdir()
    (folder / "outbox.db").write_bytes(b"no database at all" * 1000)
    bench = OutboxOnLoop(folder)
    async with bench.outbox.running():
        (keeping,) = await bench.take_all(1)
        assert keeping.trouble is None
        assert bench.codes() == ["outbox.replaced"]
        assert "corrupt-" in bench.occurrences[0].text
    (aside,) = folder.glob("outbox.db.corrupt-*")
    assert aside.read_bytes().startswith(b"no database at all")


@pytest.mark.parametrize("is_table_dropped", [False, True])
async def test_unsent_points_of_a_damaged_file_are_taken_over(
    tmp_path, is_table_dropped
):
    first = OutboxOnLoop(tmp_path)
    async with first.outbox.running():
        await first.take_all(60)
        first.send(20)
    if is_table_dropped:
        execute(first.path, "DROP TABLE room")
    else:
        damage(first.path)
    second = OutboxOnLoop(tmp_path)
    async with second.outbox.running():
        keeping = second.take()
        await until(lambda: keeping.is_settled, "a new one")
        assert await second.send_until(41) == numbers("point", *range(20, 60), 0)
        (event,) = second.occurrences
        assert event.code == "outbox.replaced"
        assert "with 40 points that had not been sent" in event.text
        answer = await second.resend()
        assert [s["begun_ns"] for s in answer["sessions"]] == ["1", "1"]
        assert answer["sessions"][0]["first_seq"] == 20


async def test_damage_while_it_runs_loses_no_number(bench):
    """It is noticed with the next read of the damaged bytes.

    Points that had been kept go on to the broker; new ones go to a new file.
    """
    await bench.take_all(30)
    await damage_while_open(bench, is_cached=False)
    (keeping,) = await bench.take_all(1)
    assert keeping.trouble is None
    assert bench.codes() == ["outbox.replaced"]
    assert "with 30 points that had not been sent" in bench.occurrences[0].text
    await bench.take_all(5)
    sent = await bench.send_until(66)  # the 30 also as taken over by the new file
    assert sent[:30] == numbers("point", *range(30))
    assert sent[30:] == numbers("point", *range(36))


async def test_damage_of_a_page_in_the_cache_is_mended_by_the_next_points(tmp_path):
    """Nobody reads the damaged bytes: the page is written whole again."""
    first = OutboxOnLoop(tmp_path)
    async with first.outbox.running():
        await first.take_all(30)
        await damage_while_open(first, is_cached=True)
        keepings = await first.take_all(5)
        assert [keeping.trouble for keeping in keepings] == [None] * 5
        assert first.send() == numbers("point", *range(35))
        assert first.codes() == []
    second = OutboxOnLoop(tmp_path)
    async with second.outbox.running():
        await second.take_all(1)
        assert second.codes() == []
    assert [row[1] for row in rows(second.path)] == [*range(35), 0]


async def damage_while_open(bench, *, is_cached):
    """Damage the file on the thread that writes it, at a moment that is not by chance.

    Nothing of the log may hide the damage: it is emptied first. What SQLite has read
    and written stays in its cache, unless that is emptied, too.
    """
    is_done = asyncio.get_running_loop().create_future()

    def work(store):
        store.connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        damage(bench.path)
        if not is_cached:
            store.connection.execute("PRAGMA shrink_memory").fetchall()

    bench.outbox._writer.query(work, is_done.set_result)
    assert await is_done is None


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


async def test_a_file_that_is_removed_is_replaced_and_numbers_continue(bench):
    await bench.take_all(3)
    for end in ("", "-wal", "-shm"):
        with contextlib.suppress(FileNotFoundError):
            bench.path.with_name(f"outbox.db{end}").unlink()
    await until(lambda: "outbox.replaced" in bench.codes(), "it is noticed")
    await bench.take_all(2)
    assert [row[1] for row in rows(bench.path)] == [0, 1, 2, 3, 4]

    def are_marked() -> bool:
        bench.send()
        bench.outbox.poll()
        return [row[2] for row in rows(bench.path)] == [1] * 5

    await until(are_marked, "marks fit the new one")


async def test_a_newer_file_is_refused_at_the_start(tmp_path):
    bench = OutboxOnLoop(tmp_path)
    async with bench.outbox.running():
        await bench.take_all(1)
    execute(bench.path, "PRAGMA user_version = 9")
    with pytest.raises(DatabaseRefusedError, match="version 9"):
        async with OutboxOnLoop(tmp_path).outbox.running():
            pass


async def test_two_daemons_do_not_share_a_state_folder(bench, tmp_path):
    with pytest.raises(DatabaseRefusedError, match="another daemon uses"):
        async with OutboxOnLoop(tmp_path).outbox.running():
            pass
    assert (await bench.take_all(1))[0].trouble is None


async def test_a_state_folder_that_cannot_be_had_is_refused(tmp_path):
    (tmp_path / "state").write_text("a file")
    with pytest.raises(DatabaseRefusedError, match="STATE_DIRECTORY"):
        async with OutboxOnLoop(tmp_path / "state").outbox.running():
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


@pytest.mark.parametrize(
    ("changed", "words", "remedy"),
    [
        ({6: 0}, "no inodes left", "remove files from the disk"),
        ({8: os.ST_RDONLY}, "mounted read-only", "to be written"),
        ({}, "cannot be opened", "accessible to the daemon's user"),
    ],
)
def test_why_no_file_can_be_opened_is_looked_up_at_its_disk(
    tmp_path, monkeypatch, changed, words, remedy
):
    """SQLite says the same of a disk without inodes as of a folder of others."""
    with pytest.raises(sqlite3.OperationalError) as caught:
        sqlite3.connect(tmp_path).execute("SELECT 1")  # a folder is no database
    disk = list(os.statvfs(tmp_path))
    for place, value in {5: 1000, 6: 10, 8: 0, **changed}.items():
        disk[place] = value
    monkeypatch.setattr(os, "statvfs", lambda path: os.statvfs_result(disk))
    trouble = storage_error_of(caught.value, tmp_path / "outbox.db")
    assert words in trouble.text
    assert remedy in trouble.remedy


@pytest.mark.parametrize("kind", ["fifo", "folder"])
async def test_something_else_in_the_place_of_the_file_is_named(tmp_path, kind):
    bench = OutboxOnLoop(tmp_path)
    bench.path.parent.mkdir(exist_ok=True)
    if kind == "fifo":
        os.mkfifo(bench.path)
    else:
        bench.path.mkdir()
    async with bench.outbox.running():
        await until(lambda: not bench.outbox.is_ready, "the trouble")
        trouble = bench.outbox.status.trouble
        assert "no regular file" in trouble.text
        assert f"move {bench.path} away" in trouble.remedy
