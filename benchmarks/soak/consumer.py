"""`python -m benchmarks.soak.consumer ARM BROKER STORE`: points into its own store.

The cursor is in the store, in the same transaction as the points: a consumer that is
killed stores every point once. It has no other memory.
"""

import asyncio
import contextlib
import json
import signal
import sqlite3
from dataclasses import asdict
from pathlib import Path

from benchmarks.tools.command_line import run_main
from traverse.client import Arm, Lost
from traverse.protocol.messages import Point

TABLES = """
CREATE TABLE IF NOT EXISTS points (
    arrival INTEGER PRIMARY KEY AUTOINCREMENT,
    id TEXT NOT NULL UNIQUE,
    session TEXT NOT NULL,
    seq INTEGER NOT NULL,
    trigger TEXT NOT NULL,
    counts TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS losses (session TEXT, from_seq INTEGER, to_seq INTEGER,
    reason TEXT);
CREATE TABLE IF NOT EXISTS place (session TEXT PRIMARY KEY, next_seq INTEGER);
CREATE TABLE IF NOT EXISTS figures (life INTEGER PRIMARY KEY AUTOINCREMENT, text TEXT);
"""


class Store:
    """Points on disk."""

    def __init__(self, path: Path) -> None:
        self._database = sqlite3.connect(path)
        self._database.executescript(TABLES)
        cursor = self._database.execute("INSERT INTO figures (text) VALUES ('{}')")
        self._life = cursor.lastrowid
        self._database.commit()

    def close(self) -> None:
        self._database.close()

    def place(self) -> dict[str, int]:
        rows = self._database.execute("SELECT session, next_seq FROM place")
        return dict(rows.fetchall())

    def put(self, items: list[Point | Lost], figures: dict[str, int]) -> None:
        """Store points, losses and the cursor, or nothing of it."""
        with self._database as database:
            for item in items:
                if isinstance(item, Point):
                    row = (item.id, item.session, item.seq, item.trigger)
                    database.execute(
                        "INSERT INTO points (id, session, seq, trigger, counts) "
                        "VALUES (?, ?, ?, ?, ?)",
                        (*row, json.dumps(item.counts)),
                    )
                else:
                    database.execute(
                        "INSERT INTO losses VALUES (?, ?, ?, ?)",
                        (item.session, item.from_seq, item.to_seq, item.reason),
                    )
                last = item.seq if isinstance(item, Point) else item.to_seq
                if last is not None:
                    database.execute("DELETE FROM place")
                    place = (item.session, last + 1)
                    database.execute("INSERT INTO place VALUES (?, ?)", place)
            database.execute(
                "UPDATE figures SET text = ? WHERE life = ?",
                (json.dumps(figures), self._life),
            )


async def main(arm_name: str, broker: str, path: Path) -> None:
    ended = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, ended.set)
    with contextlib.closing(Store(path)) as store:
        await follow(arm_name, broker, store, ended)


async def follow(
    arm_name: str, broker: str, store: Store, ended: asyncio.Event
) -> None:
    arm = Arm(arm_name, broker, since=store.place(), connect_timeout_s=3600.0)
    async with arm:
        reader = arm.points_and_losses()
        ending = asyncio.create_task(ended.wait())
        while not ended.is_set():
            first = asyncio.ensure_future(anext(reader))
            await asyncio.wait({first, ending}, return_when=asyncio.FIRST_COMPLETED)
            if not first.done():
                first.cancel()
                break
            items = [first.result()]
            while reader.waiting and len(items) < 500:
                items.append(await anext(reader))
            store.put(items, asdict(arm.counters))


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        run_main(main)
