"""Arms, members of a group, a broker and a database that die at random.

At the end every point of every arm's outbox has to be in the store, once.
"""

import asyncio
import contextlib
import random
import signal
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import aiomqtt

from tests.client.virtual_daemon import VirtualDaemon
from tests.mosquitto import Mosquitto
from tests.postgres import Postgres
from traverse.fleet.database import Database
from traverse.fleet.opening import open_database

PATIENCE_S = 90.0


@dataclass
class Result:
    captured: int = 0
    kills: dict[str, int] = field(default_factory=dict)
    lost: int = 0
    doubled: int = 0
    invented: int = 0
    incomplete: list[tuple[object, ...]] = field(default_factory=list)
    written_off: int = 0


class Members:
    def __init__(self, broker: Mosquitto, database: str, folder: Path, n: int) -> None:
        self._broker, self._database, self._folder = broker, database, folder
        self._running: list[subprocess.Popen[bytes] | None] = [None] * n
        for number in range(n):
            self.start(number)

    def start(self, number: int) -> None:
        with (self._folder / f"member-{number}.log").open("ab") as log:
            self._running[number] = subprocess.Popen(
                [
                    *(sys.executable, "-m", "traverse", "store"),
                    *("--broker", f"{self._broker.host}:{self._broker.port}"),
                    *("--database", self._database),
                    *("--scans", str(self._folder / "scans")),
                    *("--member", f"m{number}", "--gap-s", "1", "--list-s", "2"),
                ],
                stdout=log,
                stderr=log,
            )

    def kill(self, number: int) -> None:
        process = self._running[number]
        if process is not None:
            process.kill()
            process.wait()
            self._running[number] = None

    def stop(self) -> list[int]:
        statuses = []
        for number, process in enumerate(self._running):
            if process is None:
                continue
            process.send_signal(signal.SIGTERM)
            statuses.append(process.wait(30))
            self._running[number] = None
        return statuses

    async def are_connected(self) -> None:
        until_s = asyncio.get_running_loop().time() + PATIENCE_S
        while not all("connected to" in self.log(n) for n in range(len(self._running))):
            assert asyncio.get_running_loop().time() < until_s
            await asyncio.sleep(0.1)

    def log(self, number: int) -> str:
        return (self._folder / f"member-{number}.log").read_text()


async def life(arm: VirtualDaemon, ended: asyncio.Event, chance: random.Random) -> None:
    """An arm that takes points, and comes back when its broker does."""
    while not ended.is_set():
        with contextlib.suppress(aiomqtt.MqttError, OSError):
            async with arm.running():
                while not ended.is_set():
                    await arm.take(chance.randrange(1, 8))
                    await asyncio.sleep(chance.uniform(0.0, 0.3))
        await asyncio.sleep(0.1)


async def online(arm: VirtualDaemon, ended: asyncio.Event) -> None:
    while not ended.is_set():
        with contextlib.suppress(aiomqtt.MqttError, OSError):
            async with arm.running():
                await ended.wait()
        await asyncio.sleep(0.1)


async def chaos(
    broker: Mosquitto,
    postgres: Postgres | None,
    folder: Path,
    *,
    n_arms: int,
    n_members: int,
    n_kills: int,
    seed: int,
) -> Result:
    chance = random.Random(seed)
    url = str(folder / "store.db") if postgres is None else postgres.url
    members = Members(broker, url, folder, n_members)
    await members.are_connected()
    arms = [VirtualDaemon(f"arm-{n}", broker.host, broker.port) for n in range(n_arms)]
    result, over, stopped = Result(), asyncio.Event(), asyncio.Event()
    try:
        async with asyncio.TaskGroup() as group:
            for arm in arms:
                chance_of_arm = random.Random(chance.random())
                group.create_task(life(arm, over, chance_of_arm))
            await asyncio.sleep(3.0)
            for _ in range(n_kills):
                await asyncio.sleep(chance.uniform(0.2, 1.5))
                victim = chance.choices(
                    ["member", "database", "broker"], [6, 2, 1 if postgres else 2]
                )[0]
                if victim == "database" and postgres is None:
                    victim = "member"
                result.kills[victim] = result.kills.get(victim, 0) + 1
                await asyncio.to_thread(
                    _kill, victim, members, broker, postgres, chance
                )
            over.set()
        async with asyncio.TaskGroup() as group:
            for arm in arms:
                group.create_task(online(arm, stopped))
            await _complete(url, arms)
            stopped.set()
        statuses = await asyncio.to_thread(members.stop)
        # One that was started just now has not begun to listen to signals.
        assert set(statuses) <= {0, -signal.SIGTERM}, statuses
    finally:
        for number in range(n_members):
            members.kill(number)
    _compare(url, arms, result)
    return result


def _kill(
    victim: str,
    members: Members,
    broker: Mosquitto,
    postgres: Postgres | None,
    chance: random.Random,
) -> None:
    if victim == "member":
        number = chance.randrange(len(members._running))
        members.kill(number)
        members.start(number)
    elif victim == "broker":
        broker.kill()
        broker.start()
    elif postgres is not None:
        postgres.kill()
        postgres.start()


async def _complete(url: str, arms: list[VirtualDaemon]) -> None:
    """Wait until the store has as many as the arms, or nothing comes for long."""
    expected = sum(len(arm.points) for arm in arms)
    database = open_database(url)
    n_before, since_s = -1, asyncio.get_running_loop().time()
    try:
        while asyncio.get_running_loop().time() - since_s < PATIENCE_S:
            (now,) = _select(database, "SELECT count(*) FROM point")[0]
            (waiting,) = _select(
                database, "SELECT count(*) FROM series WHERE complete_to < last_seq"
            )[0]
            if now >= expected and not waiting:
                return
            if now != n_before:
                n_before, since_s = now, asyncio.get_running_loop().time()
            await asyncio.sleep(0.5)
    finally:
        database.close()


def _select(database: Database, statement: str) -> list[tuple[object, ...]]:
    with database.transaction() as run:
        return run(statement)


def _compare(url: str, arms: list[VirtualDaemon], result: Result) -> None:
    database = open_database(url)
    rows = _select(database, "SELECT id, arm, session, seq FROM point")
    captured = {(p.id, arm.arm, p.session, p.seq) for arm in arms for p in arm.points}
    result.captured = len(captured)
    result.doubled = len(rows) - len(set(rows))
    result.lost = len(captured - set(rows))
    result.invented = len(set(rows) - captured)
    result.incomplete = _select(
        database, "SELECT * FROM series WHERE complete_to < last_seq"
    )
    result.written_off = len(_select(database, "SELECT * FROM lost"))
    database.close()
