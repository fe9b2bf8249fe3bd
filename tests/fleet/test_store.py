import sqlite3
import threading
import time

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.protocol.message_examples import EVENT, HEALTH, POINT, SCAN, STATUS
from traverse.client.mqtt.connection import IncomingMessage
from traverse.fleet.database import StoreAwayError, StoreRefusedError
from traverse.fleet.gaps import MOST_ASKED, find_gaps, mark_lost, take_lease
from traverse.fleet.opening import open_database
from traverse.fleet.rows import listed_series
from traverse.fleet.scan_files import ScanFiles
from traverse.fleet.store import REFUSED_KEPT, Store
from traverse.fleet.tables import STEPS, migrate
from traverse.protocol.encoding import encode

pytestmark = pytest.mark.needs("postgresql")


@pytest.fixture
def store(database, tmp_path):
    return Store(database, ScanFiles(str(tmp_path / "scans"), "m1"))


def select(database, statement, values=()):
    with database.transaction() as run:
        return run(statement, values)


def received(message, arm="bench-7", encoding="msgpack"):
    kind = type(message).__name__.lower()
    payload = encode(message, encoding)
    return IncomingMessage(f"traverse/{arm}/{kind}", payload, 1, lambda _: None)


def point(seq, session="s", **changes):
    fields = {"seq": seq, "session": session, "id": f"{session}-{seq}", **changes}
    return POINT.model_copy(update=fields)


def test_a_point_is_stored_once_with_its_bytes(store, database):
    message = received(POINT)
    store.write([message, message])
    store.write([message])
    rows = select(
        database,
        "SELECT id, arm, seq, x_mm, z_mm, ok, flags, std_mm, message FROM point",
    )
    ((name, arm, seq, x_mm, z_mm, ok, flags, std_mm, payload),) = rows
    assert (name, arm, seq) == (POINT.id, "bench-7", POINT.seq)
    assert (x_mm, z_mm) == (POINT.xyz_mm[0], POINT.xyz_mm[2])
    assert (bool(ok), flags) == (POINT.quality.ok, " ".join(POINT.quality.flags))
    variances = [POINT.covariance_mm2[i] for i in (0, 3, 5)]
    assert std_mm == pytest.approx(np.sqrt(sum(variances)))
    assert bytes(payload) == message.payload


def test_an_undo_that_comes_first_counts(store, database):
    first = point(0)
    undo = first.retraction(
        seq=1, point_id="s-1", trigger="command", time_ns=first.time_ns + 1
    )
    store.write([received(undo)])
    store.write([received(first), received(point(2))])
    assert select(database, "SELECT id FROM standing_point") == [("s-2",)]


def test_events_states_and_health(store, database):
    store.write([received(EVENT), received(EVENT), received(STATUS), received(HEALTH)])
    newer = HEALTH.model_copy(update={"time_ns": HEALTH.time_ns + 5})
    store.write([received(newer)])
    store.write([received(HEALTH)])  # late
    offline = STATUS.model_copy(update={"online": False, "state": "offline"})
    store.write([received(offline)])
    assert select(database, "SELECT count(*) FROM event") == [(1,)]
    ((state, online),) = select(database, "SELECT state, online FROM arm")
    assert (state, bool(online)) == ("offline", False)
    assert select(database, "SELECT time_ns FROM health") == [(newer.time_ns,)]


def test_bad_messages_are_told_and_the_good_ones_beside_them_stored(store, database):
    bad = IncomingMessage("traverse/bench-7/point", b"\xff\x00", 1, lambda _: None)
    null = point(1, id="x\x00y")  # PostgreSQL takes no such text
    store.write([received(point(0)), bad, received(null), received(point(2))])
    reasons = select(database, "SELECT topic, reason FROM refused ORDER BY reason")
    assert reasons[-1][0] == "traverse/bench-7/point"
    assert store.n_refused == len(reasons)
    ids = {name for (name,) in select(database, "SELECT id FROM point")}
    assert {"s-0", "s-2"} <= ids
    assert len(ids) + len(reasons) == 4


def test_what_was_refused_is_bounded(store, database):
    bad = IncomingMessage("traverse/a/point", b"\xff", 1, lambda _: None)
    for _ in range(3):
        store.write([bad] * (REFUSED_KEPT // 2))
    (n_refused,) = select(database, "SELECT count(*) FROM refused")[0]
    assert n_refused == REFUSED_KEPT
    assert store.n_refused == 3 * (REFUSED_KEPT // 2)


def test_blocks_of_scans_are_files_by_arm_and_day(store, database, tmp_path):
    block = received(SCAN, "hall 3")
    store.write([block, block])
    store.write([block])
    ((file, points),) = select(database, "SELECT file, points FROM scan_block")
    assert file.startswith("arm=hall%203/day=2026-11-21/m1-")
    table = pq.read_table(tmp_path / "scans" / file)
    assert len(table) == points == len(SCAN.dtime_ns)
    np.testing.assert_array_equal(table["x_mm"], SCAN.xyz_mm[:, 0])
    np.testing.assert_array_equal(table["k"], SCAN.ijk[:, 2])
    np.testing.assert_array_equal(table["time_ns"], SCAN.time_ns + SCAN.dtime_ns)
    np.testing.assert_array_equal(table["number"], SCAN.seq + np.arange(len(table)))
    assert table["angles_rad"].to_pylist() == SCAN.angles_rad.tolist()
    assert [p.name for p in (tmp_path / "scans").rglob("*.part")] == []


def test_gaps_near_each_other_are_one_and_far_ones_wait(store, database):
    far = MOST_ASKED + 50
    store.write([received(point(n)) for n in (0, 1, 4, 6, far)])
    (gap,) = find_gaps(database, 7)
    assert (gap.arm, gap.session, gap.scan) == ("bench-7", "s", "")
    assert (gap.from_seq, gap.to_seq, gap.since_ns) == (2, 2 + MOST_ASKED - 1, 7)
    store.write([received(point(n)) for n in range(far)])
    assert find_gaps(database, 8) == []
    assert select(database, "SELECT complete_to, gap_since_ns FROM series") == [
        (far, None)
    ]


def test_what_is_lost_is_no_gap_and_what_an_arm_lists_is_one(store, database):
    store.write([received(point(n)) for n in (3, 4)])
    (gap,) = find_gaps(database, 1)
    assert (gap.from_seq, gap.to_seq) == (0, 2)
    store.write([received(point(1))])  # it has arrived meanwhile
    assert mark_lost(database, gap, 2, "gone") == [(0, 0), (2, 2)]
    assert find_gaps(database, 3) == []
    session = {"session": "s", "begun_ns": "5", "first_seq": 3, "last_seq": 9}
    scan = {"scan": "c", "session": "s", "begun_ns": "6", "last_block_seq": 40}
    listed_series(database, "bench-7", {"sessions": [session], "scans": [scan]})
    gaps = {(g.scan, g.from_seq, g.to_seq) for g in find_gaps(database, 4)}
    assert gaps == {("", 5, 9), ("c", 0, 40)}
    assert select(database, "SELECT reason FROM lost") == [("gone",)] * 2


def test_blocks_of_scans_have_gaps_by_their_points(store, database):
    n = len(SCAN.dtime_ns)
    blocks = [
        SCAN.model_copy(update={"seq": seq, "last": False, "total": None, "dropped": 0})
        for seq in (0, n, 3 * n)
    ]
    store.write([received(block) for block in blocks])
    (gap,) = find_gaps(database, 1)
    assert (gap.scan, gap.from_seq, gap.to_seq) == (SCAN.scan, 2 * n, 3 * n - 1)


def test_one_member_at_a_time_has_the_lease(database):
    assert take_lease(database, "gaps", "a", 100, 50)
    assert not take_lease(database, "gaps", "b", 120, 50)
    assert take_lease(database, "gaps", "a", 140, 50)
    assert take_lease(database, "gaps", "b", 191, 50)


def test_members_that_begin_at_once_make_the_tables_once(database, tmp_path):
    with database.transaction() as run:
        assert run("SELECT max(version) FROM store_version") == [(len(STEPS),)]
    assert migrate(database) == 0


@pytest.mark.parametrize("n", [4])
def test_a_file_is_made_by_many_at_once(tmp_path, n):
    url, done, faults = str(tmp_path / "new.db"), [], []

    def make():
        try:
            opened = open_database(url)
            done.append(migrate(opened))
            opened.close()
        except Exception as error:  # noqa: BLE001 - of another thread
            faults.append(error)

    threads = [threading.Thread(target=make) for _ in range(n)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (sum(done), faults) == (len(STEPS), [])


def test_tables_of_a_later_version_are_refused(database):
    with database.transaction() as run:
        run("INSERT INTO store_version VALUES (99)")
    with pytest.raises(StoreRefusedError, match="version 99; this Traverse knows"):
        migrate(database)


def test_a_store_of_the_first_version_is_brought_on(tmp_path, monkeypatch):
    url = str(tmp_path / "old.db")
    monkeypatch.setattr("traverse.fleet.tables.STEPS", STEPS[:1])
    old = open_database(url)
    assert migrate(old) == 1
    Store(old, ScanFiles(str(tmp_path), "m")).write([received(POINT)])
    old.close()
    monkeypatch.undo()
    new = open_database(url)
    assert migrate(new) == len(STEPS) - 1
    assert select(new, "SELECT count(*) FROM point") == [(1,)]
    assert select(new, "SELECT count(*) FROM daily_check") == [(0,)]
    new.close()


def test_a_database_that_died_is_away_and_nothing_is_half_stored(postgres, tmp_path):
    opened = open_database(postgres.url)
    migrate(opened)
    store = Store(opened, ScanFiles(str(tmp_path), "m"))
    postgres.kill()
    with pytest.raises(StoreAwayError, match=f"{postgres.port}/fleet"):
        store.write([received(POINT)])
    postgres.start()
    store.write([received(POINT)])
    assert select(opened, "SELECT count(*) FROM point") == [(1,)]
    opened.close()


def test_a_locked_file_is_away(tmp_path, monkeypatch):
    monkeypatch.setattr("traverse.fleet.database._PATIENCE_S", 0.1)
    opened = open_database(str(tmp_path / "store.db"))
    migrate(opened)
    other = sqlite3.connect(tmp_path / "store.db", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    began_s = time.monotonic()
    with pytest.raises(StoreAwayError, match="locked"):
        select(opened, "SELECT 1")
    assert time.monotonic() - began_s < 10.0
    other.close()
    assert select(opened, "SELECT 1") == [(1,)]
    opened.close()


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("mysql://host/database", "mysql://: no such database; expected a file"),
        ("/nowhere/at/all.db", "name a file that can be written"),
        ("postgresql://host/db?nonsense=1", "expected postgresql://user@host/database"),
    ],
)
def test_what_is_no_database_is_refused(url, expected):
    with pytest.raises(StoreRefusedError, match=expected):
        open_database(url)


def test_a_place_for_scans_that_cannot_be_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for root in (str(tmp_path / "file" / "below"), "nonsense://bucket"):
        with pytest.raises(StoreRefusedError, match="expected a folder or a URI"):
            ScanFiles(root, "m")
