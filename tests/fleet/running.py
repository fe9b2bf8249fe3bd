"""`traverse store` in a folder, as a process, and its database."""

import asyncio
import contextlib
import signal
import sqlite3
import sys
import time

PATIENCE_S = 60.0


class Running:
    def __init__(self, process):
        self.process = process
        self.lines = []
        self._reading = asyncio.create_task(self._read())

    async def _read(self):
        async for line in self.process.stderr:
            self.lines.append(line.decode().rstrip())

    async def says(self, text):
        until_s = time.monotonic() + PATIENCE_S
        while not any(text in line for line in self.lines):
            assert time.monotonic() < until_s, self.lines
            await asyncio.sleep(0.05)

    async def ended(self):
        status = await asyncio.wait_for(self.process.wait(), PATIENCE_S)
        await self._reading
        return status

    async def stop(self):
        if self.process.returncode is None:
            self.process.send_signal(signal.SIGTERM)
        return await self.ended()


@contextlib.asynccontextmanager
async def started(folder, broker, *words):
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "traverse", "store"),
        *("--broker", f"{broker.host}:{broker.port}", "--gap-s", "1", "--list-s", "1"),
        *words,
        cwd=folder,
        stderr=asyncio.subprocess.PIPE,
    )
    member = Running(process)
    try:
        yield member
    finally:
        if process.returncode is None:
            process.kill()
        await member.ended()


def rows(folder, statement):
    with sqlite3.connect(folder / "traverse-store.db") as connection:
        result = connection.execute(statement).fetchall()
    connection.close()
    return result


async def becomes(folder, statement, expected):
    until_s = time.monotonic() + PATIENCE_S
    while (present := rows(folder, statement)) != expected:
        assert time.monotonic() < until_s, present
        await asyncio.sleep(0.1)
