"""Points into a database: a member of a store beside the bare database.

python -m benchmarks.fleet.store [--rounds N] [--points N]

In turns, in batches of 1000: `COPY` of rows, `executemany` of the same inserts, and a
member's whole path, which decodes each message, keeps the series and commits.
PostgreSQL and SQLite, both with every commit on the disk.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import psycopg

from tests.postgres import Postgres
from tests.protocol.message_examples import POINT
from traverse.client.mqtt.connection import IncomingMessage
from traverse.fleet.opening import open_database
from traverse.fleet.rows import Rows
from traverse.fleet.scan_files import ScanFiles
from traverse.fleet.store import Store
from traverse.fleet.tables import migrate
from traverse.protocol.encoding import encode

BATCH = 1000
Work = Callable[[Sequence[IncomingMessage]], None]


def messages(n: int, start: int) -> list[IncomingMessage]:
    """Points of ten arms, with numbers from a start."""
    payloads = []
    for number in range(start, start + n):
        arm = f"arm-{number % 10}"
        point = POINT.model_copy(
            update={
                "arm": arm,
                "session": arm,
                "seq": number // 10,
                "id": f"{arm}-{number}",
                "time_ns": POINT.time_ns + number,
            }
        )
        payload = encode(point, "msgpack")
        payloads.append(
            IncomingMessage(f"traverse/{arm}/point", payload, 1, lambda _: None)
        )
    return payloads


def rows_of(messages: Sequence[IncomingMessage]) -> list[Sequence[object]]:
    rows = Rows()
    for message in messages:
        rows.add("point", message.topic.split("/")[1], message.payload)
    return list(rows.points)


def bare(url: str) -> Iterator[tuple[str, Work]]:
    """The database alone: rows are made before."""
    connection = psycopg.connect(url)
    columns = (
        "id, arm, session, seq, time_ns, retracts, x_mm, y_mm, z_mm, part_x_mm, "
        "part_y_mm, part_z_mm, std_mm, temperature_c, artefact, feature, ok, flags, "
        "model, message"
    )

    def copy(batch: Sequence[IncomingMessage]) -> None:
        statement = f"COPY point ({columns}) FROM STDIN"
        with connection.cursor() as cursor, cursor.copy(statement) as target:
            for row in made[batch[0].topic, id(batch)]:
                target.write_row(row)
        connection.commit()

    def many(batch: Sequence[IncomingMessage]) -> None:
        marks = ", ".join(["%s"] * 20)
        with connection.cursor() as cursor:
            cursor.executemany(
                f"INSERT INTO point ({columns}) VALUES ({marks})",
                made[batch[0].topic, id(batch)],
            )
        connection.commit()

    yield "COPY", copy
    yield "executemany", many


made: dict[tuple[str, int], list[Sequence[object]]] = {}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--points", type=int, default=10_000)
    arguments = parser.parse_args()
    postgres = Postgres()
    by_variant: dict[str, list[float]] = {}
    try:
        url = postgres.new_database("fleet")
        with tempfile.TemporaryDirectory() as folder:
            works = dict(bare(url))
            for name, place in (
                ("member, PostgreSQL", url),
                ("member, SQLite", f"{folder}/store.db"),
            ):
                database = open_database(place)
                migrate(database)
                works[name] = Store(database, ScanFiles(folder, "m")).write
            start = 0
            for _ in range(arguments.rounds):
                for name, work in works.items():
                    sent = messages(arguments.points, start)
                    start += arguments.points
                    batches = [sent[n : n + BATCH] for n in range(0, len(sent), BATCH)]
                    for batch in batches:
                        made[batch[0].topic, id(batch)] = rows_of(batch)
                    begun_s = time.perf_counter()
                    for batch in batches:
                        work(batch)
                    took_s = time.perf_counter() - begun_s
                    by_variant.setdefault(name, []).append(arguments.points / took_s)
                    made.clear()
            size = Path(folder, "store.db").stat().st_size
            stored = arguments.rounds * arguments.points
            with psycopg.connect(url) as connection:
                ((total, rows),) = connection.execute(
                    "SELECT pg_total_relation_size('point'), count(*) FROM point"
                )
    finally:
        postgres.close()
    base = statistics.median(by_variant["COPY"])
    for name, rates in by_variant.items():
        median = statistics.median(rates)
        print(
            f"{name:20} {median:8.0f} points/s ({min(rates):.0f} to {max(rates):.0f}), "
            f"{median / base:.2f} of COPY"
        )
    print(f"bytes a point: PostgreSQL {total / rows:.0f}, SQLite {size / stored:.0f}")


if __name__ == "__main__":
    main()
