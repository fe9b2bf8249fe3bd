"""Every point of an arm exactly once in a database, even if programs are killed.

Points and the place where to go on are written in one transaction.
"""

import asyncio
import sqlite3
import sys

from traverse import Arm
from traverse.protocol.messages import Point

TABLES = """
CREATE TABLE IF NOT EXISTS points (id TEXT PRIMARY KEY, session TEXT, seq INTEGER,
    x_mm REAL, y_mm REAL, z_mm REAL, retracts TEXT);
CREATE TABLE IF NOT EXISTS place (session TEXT PRIMARY KEY, next_seq INTEGER);
"""


def keep(database: sqlite3.Connection, point: Point) -> None:
    row = (point.id, point.session, point.seq, *point.xyz_mm, point.retracts)
    with database:
        database.execute("INSERT INTO points VALUES (?, ?, ?, ?, ?, ?, ?)", row)
        database.execute("DELETE FROM place")
        place = (point.session, point.seq + 1)
        database.execute("INSERT INTO place VALUES (?, ?)", place)


async def main(arm_name: str, broker: str, path: str) -> None:
    database = sqlite3.connect(path)
    database.executescript(TABLES)
    place = dict(database.execute("SELECT session, next_seq FROM place").fetchall())
    async with Arm(arm_name, broker, since=place) as arm:
        async for point in arm.points():
            keep(database, point)


asyncio.run(main(*sys.argv[1:4]))
