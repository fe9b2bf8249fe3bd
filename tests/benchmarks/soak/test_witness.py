import ast
import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import msgpack
import pytest

from benchmarks.soak import witness
from benchmarks.soak.witness import TABLES, faults, seen
from tests.protocol.message_examples import POINT
from traverse.protocol.encoding import encode

OUTBOX = "CREATE TABLE messages (number INTEGER PRIMARY KEY, session, seq, id, payload)"
N = 5


@pytest.fixture
def stores(tmp_path: Path) -> tuple[Path, Path]:
    store, outbox = tmp_path / "witness.db", tmp_path / "outbox.db"
    with (
        closing(sqlite3.connect(store)) as ours,
        closing(sqlite3.connect(outbox)) as db,
    ):
        ours.executescript(TABLES)
        db.execute(OUTBOX)
        for seq in range(N):
            name, data = f"p{seq}", f"payload {seq}".encode()
            digest = witness.hashlib.sha256(data).hexdigest()
            row = ("s", seq, name, digest)
            for _ in range(1 + seq % 2):  # some arrived twice
                ours.execute("INSERT INTO arrivals VALUES (NULL, ?, ?, ?, ?)", row)
            db.execute(
                "INSERT INTO messages VALUES (NULL, 's', ?, ?, ?)", (seq, name, data)
            )
        ours.execute("INSERT INTO promised VALUES ('p3')")
        ours.commit()
        db.commit()
    return store, outbox


def test_a_sound_run_has_no_faults(stores: tuple[Path, Path]) -> None:
    figures, complaints = faults(*stores)
    assert complaints == []
    assert figures["witness: messages"] == N + N // 2
    assert seen(stores[0]) == (N, 0)


@pytest.mark.parametrize(
    ("store", "change", "text"),
    [
        (0, "DELETE FROM arrivals WHERE id = 'p3'", "promised, but never arrived"),
        (0, "DELETE FROM arrivals WHERE seq = 4", "in the outbox, but never arrived"),
        (1, "DELETE FROM messages WHERE seq = 4", "arrived, but not in the outbox"),
        (0, "UPDATE arrivals SET digest = 'x' WHERE n = 2", "several contents"),
        (
            1,
            "UPDATE messages SET payload = x'78' WHERE seq = 0",
            "other than it is kept",
        ),
        (0, "UPDATE arrivals SET seq = 9 WHERE n = 2", "under several numbers"),
        (1, "UPDATE messages SET seq = 7 WHERE seq = 2", "numbers are not 0, 1, 2"),
        (0, "DELETE FROM promised", "it has seen nothing"),
    ],
)
def test_each_fault_is_found(
    store: int, change: str, text: str, stores: tuple[Path, Path]
) -> None:
    with closing(sqlite3.connect(stores[store])) as database:
        database.execute(change)
        database.commit()
    assert any(text in fault for fault in faults(*stores)[1])


def test_it_reads_messages_in_both_encodings() -> None:
    as_json = witness.read(encode(POINT, "json"))
    as_msgpack = witness.read(encode(POINT, "msgpack"))
    assert as_json["id"] == as_msgpack["id"] == POINT.id
    assert msgpack.unpackb(encode(POINT, "msgpack"))["seq"] == POINT.seq


def test_it_shares_no_code_with_the_project() -> None:
    tree = ast.parse(Path(witness.__file__).read_text("utf-8"))
    modules = {
        name.partition(".")[0]
        for node in ast.walk(tree)
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or "."]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert modules <= {*sys.stdlib_module_names, "msgpack", "paho"}
