"""`traverse store` as a user runs it: beside another, and with an arm that forgets."""

import asyncio
import signal
import sqlite3
import sys
import time

import pytest

from tests.client.virtual_daemon import VirtualDaemon
from tests.protocol.message_examples import SCAN
from traverse.client.cancel_tasks import cancel_tasks

pytestmark = pytest.mark.needs("mosquitto")
PATIENCE_S = 30.0


class Running:
    """A member in a folder, with what it says."""

    def __init__(self, process):
        self.process = process
        self.said = []
        self._reading = asyncio.create_task(self._read())

    async def _read(self):
        async for line in self.process.stderr:
            self.said.append(line.decode().rstrip())

    async def says(self, text):
        until_s = time.monotonic() + PATIENCE_S
        while not any(text in line for line in self.said):
            assert time.monotonic() < until_s, self.said
            await asyncio.sleep(0.05)

    async def ended(self):
        status = await asyncio.wait_for(self.process.wait(), PATIENCE_S)
        await self._reading
        return status

    async def stop(self):
        if self.process.returncode is None:
            self.process.send_signal(signal.SIGTERM)
        status = await self.ended()
        await cancel_tasks([self._reading])
        return status


async def started(folder, broker, *words):
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "traverse", "store"),
        *("--broker", f"{broker.host}:{broker.port}", "--gap-s", "1", "--list-s", "1"),
        *words,
        cwd=folder,
        stderr=asyncio.subprocess.PIPE,
    )
    return Running(process)


def rows(folder, statement):
    with sqlite3.connect(folder / "traverse-store.db") as connection:
        found = connection.execute(statement).fetchall()
    connection.close()
    return found


async def becomes(folder, statement, wanted):
    until_s = time.monotonic() + PATIENCE_S
    while (found := rows(folder, statement)) != wanted:
        assert time.monotonic() < until_s, found
        await asyncio.sleep(0.1)


async def test_the_first_command_works_without_a_server(mosquitto, tmp_path):
    member = await started(tmp_path, mosquitto, "--group", tmp_path.name[:40])
    await member.says("connected to")
    arm = VirtualDaemon(f"arm-{tmp_path.name}", mosquitto.host, mosquitto.port)
    select = f"SELECT count(*) FROM point WHERE arm = '{arm.arm}'"
    async with arm.running():
        await arm.take(20)
        arm.is_mute = True
        await arm.take(5)  # nobody heard them
        arm.is_mute = False
        await arm.publish(SCAN.model_copy(update={"arm": arm.arm}))
        await becomes(tmp_path, select, [(25,)])
        # It loses points that the store does not have yet.
        arm.is_mute = True
        await arm.take(6)
        held = arm.outbox[arm.session]
        for seq in list(held)[:28]:
            del held[seq]
        arm.is_mute = False
        await member.says("25 to 27 are lost: the arm does not have them any more")
        await becomes(tmp_path, select, [(28,)])
    assert await member.stop() == 0
    assert "0 dropped" in member.said[-1]
    lost = f"SELECT from_seq, to_seq FROM lost WHERE arm = '{arm.arm}' AND scan = ''"
    assert rows(tmp_path, lost) == [(25, 27)]
    files = f"SELECT file FROM scan_block WHERE arm = '{arm.arm}'"
    for (file,) in rows(tmp_path, files):
        assert (tmp_path / "traverse-scans" / file).is_file()


async def test_a_broker_that_is_not_there_is_told(make_mosquitto, tmp_path):
    broker = make_mosquitto()
    broker.stop()
    member = await started(tmp_path, broker)
    await member.says("; tries again")
    broker.start()
    await member.says("connected to")
    assert await member.stop() == 0


async def test_two_members_of_one_name_are_refused(mosquitto, tmp_path):
    words = ("--group", tmp_path.name[:40], "--member", "one")
    first = await started(tmp_path, mosquitto, *words)
    await first.says("connected to")
    second = await started(tmp_path, mosquitto, *words)
    assert await first.ended() == 2
    assert "is called one; give each a --member of its own" in first.said[-1]
    assert await second.stop() == 0


async def test_what_cannot_be_is_refused(mosquitto, tmp_path):
    for words, said in (
        (("--group", "a/b"), "--group 'a/b': expected 1 to 40 letters"),
        (("--database", "mysql://host/x"), "mysql://: no such database"),
        (("--scans", "nonsense://x"), "expected a folder or a URI"),
    ):
        member = await started(tmp_path, mosquitto, *words)
        assert await member.ended() == 2
        assert said in " ".join(member.said)
        assert "Traceback" not in " ".join(member.said)
