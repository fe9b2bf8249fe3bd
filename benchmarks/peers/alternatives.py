"""`python -m benchmarks.peers.alternatives [FOLDER]`: libraries that were weighed.

A point on the disk: the database of the outbox (SQLite) beside LMDB with the same
guarantees, on the file system of FOLDER: synced before it returns, in order, found by
id and by session and number, unsent ones in order, each with its checksum. CPU and
elapsed time of a transaction, by turns.

A point as a message: made, validated and encoded by pydantic and msgpack beside msgspec
with the same fields and limits.
"""

import contextlib
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import lmdb
import msgpack
import msgspec
import numpy as np

from benchmarks.tools.command_line import run_main
from benchmarks.tools.rounds import Task, load, report, timed
from benchmarks.tools.sizes import sized
from tests.protocol.message_examples import POINT
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.records import NewMessage
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Point

ROUNDS = sized(7, 1)
N_WRITES = sized(150, 3)
SIZES = (1, 3, 10)
LMDB_BYTES = 1 << 30

Add = Callable[[Sequence[NewMessage]], object]


class LmdbStore:
    """The outbox's content in LMDB: four trees in one file."""

    def __init__(self, path: Path) -> None:
        self._environment = lmdb.open(str(path), map_size=LMDB_BYTES, max_dbs=4)
        names = (b"messages", b"ids", b"places", b"unsent")
        self._trees = [self._environment.open_db(name) for name in names]
        self._number = 0

    def add(self, entries: Sequence[NewMessage]) -> None:
        messages, ids, places, unsent = self._trees
        with self._environment.begin(write=True) as transaction:
            for entry in entries:
                self._number += 1
                number = self._number.to_bytes(8)
                place = f"{entry.session}\0".encode() + entry.seq.to_bytes(8)
                row = msgpack.packb(
                    (
                        *(entry.session, entry.seq, entry.id, entry.time_ns),
                        *(entry.topic, entry.encoding, entry.payload),
                        *(entry.checksum, entry.request),
                    )
                )
                id_ = entry.id.encode()
                if not transaction.put(id_, number, db=ids, overwrite=False):
                    raise ValueError(f"{entry.id} is stored already")
                transaction.put(place, number, db=places)
                transaction.put(number, row, db=messages, append=True)
                transaction.put(number, b"", db=unsent, append=True)

    def close(self) -> None:
        self._environment.close()


Name = Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
Vector = tuple[float, float, float]
Index = Annotated[int, msgspec.Meta(ge=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Digest = Annotated[str, msgspec.Meta(min_length=1, max_length=128)]


FastLabel: Any = msgspec.defstruct(
    "FastLabel",
    [
        ("artefact", Name | None),
        ("feature", Name | None),
    ],
    frozen=True,
)
FastQuality: Any = msgspec.defstruct(
    "FastQuality",
    [
        ("ok", bool),
        ("flags", tuple[str, ...]),
    ],
    frozen=True,
)
FastPoint: Any = msgspec.defstruct(
    "FastPoint",
    [
        ("schema", Literal["traverse/point/1"]),
        ("session", Name),
        ("seq", Index),
        ("id", Name),
        ("retracts", Name | None),
        ("arm", Name),
        ("model", Digest),
        ("trigger", Literal["button", "switch", "timer", "command"]),
        ("time_ns", int),
        ("xyz_mm", Vector),
        ("ijk", Vector),
        ("surface_mm", Vector | None),
        (
            "compensation",
            Literal["none", "shank", "pretouch", "pulled", "inside", "outside"],
        ),
        ("part_xyz_mm", Vector | None),
        ("covariance_mm2", tuple[float, float, float, float, float, float] | None),
        ("angles_rad", Annotated[tuple[float, ...], msgspec.Meta(max_length=32)]),
        ("counts", Annotated[tuple[int, ...], msgspec.Meta(max_length=32)]),
        ("temperature_c", float | None),
        ("probe_radius_mm", NotNegative),
        ("samples", Annotated[int, msgspec.Meta(ge=1, le=1_000_000)]),
        ("spread_mm", NotNegative | None),
        ("label", FastLabel),
        ("quality", FastQuality),
        ("previous", Digest | None),
        ("signature", str | None),
    ],
    frozen=True,
)
"""As `traverse.protocol.messages.Point`, but for what its fields say together."""


def entries(payload: bytes) -> Iterator[NewMessage]:
    begun_ns, seq = time.time_ns(), 0
    while True:
        yield NewMessage(
            f"bench-{begun_ns}",
            seq,
            f"bench-{begun_ns}-{seq}",
            begun_ns,
            "traverse/bench-7/point",
            "msgpack",
            payload,
            begun_ns,
            "",
        )
        seq += 1


def transactions_s(add: Add, source: Iterator[NewMessage], size: int) -> list[Any]:
    durations = []
    for _ in range(N_WRITES):
        some = [next(source) for _ in range(size)]
        cpu_s, begun_s = time.thread_time(), time.perf_counter()
        add(some)
        durations.append((time.thread_time() - cpu_s, time.perf_counter() - begun_s))
    return durations


def stores(folder: Path) -> None:
    payload = encode(POINT, "msgpack")
    with (
        contextlib.closing(MessageDatabase(folder / "outbox.db")) as sqlite,
        contextlib.closing(LmdbStore(folder / "lmdb")) as peer,
    ):
        for size in SIZES:
            times_of: dict[str, list[Any]] = {"SQLite": [], "LMDB": []}
            sources = {name: entries(payload) for name in times_of}
            for _ in range(ROUNDS):
                for name, add in (("SQLite", sqlite.add), ("LMDB", peer.add)):
                    times_of[name] += transactions_s(add, sources[name], size)
            for name, times_s in times_of.items():
                cpu_us, elapsed_us = np.array(times_s).T * 1e6
                p50, p99 = np.percentile(elapsed_us, (50, 99))
                print(
                    f"{name:>7}, {size:2} points a transaction: CPU "
                    f"{np.mean(cpu_us):4.0f} us; p50 {p50:5.0f}, p99 {p99:6.0f} us"
                )


def main(folder: Path = Path()) -> None:
    print(load())
    with tempfile.TemporaryDirectory(dir=folder) as name:
        stores(Path(name))
    values = {k: v for k, v in dict(POINT).items() if k != "schema_"}
    plain = POINT.model_dump()
    tasks = [
        Task("pydantic", lambda: encode(Point(**values), "msgpack")),
        Task(
            "msgspec",
            lambda: msgspec.msgpack.encode(msgspec.convert(plain, FastPoint)),
            is_peer=True,
        ),
    ]
    report([timed("a point as a message", tasks)], None)


if __name__ == "__main__":
    run_main(main)
