import asyncio
import contextlib
import json
import os
import signal
import sqlite3
import subprocess
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

import pytest

from tests.end_to_end.listener import Listener, listening
from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import SPHERE, Workbench
from tests.mosquitto import Mosquitto
from traverse.daemon.store.queries import iter_messages, open_read_only, read_sessions
from traverse.protocol.messages import Args, PointArgs, ResendArgs, UndoArgs
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")


def on_disk(bench: Workbench) -> list[tuple[str, int, bool]]:
    """(session, seq, is sent) of all points, in the order of their numbers."""
    connection = open_read_only(bench.folder / "state" / "outbox.db")
    with contextlib.closing(connection):
        messages = [
            message
            for session in read_sessions(connection, 100)
            for message in iter_messages(connection, session.session, 0, 2**53)
        ]
    messages.sort(key=lambda message: message.number)
    return [(m.session, m.seq, m.is_sent) for m in messages]


async def take(listener: Listener, n: int) -> list[tuple[str, int]]:
    answers = await asyncio.gather(*(listener.command(PointArgs()) for _ in range(n)))
    return sorted((str(a.result["session"]), a.result["seq"]) for a in answers)


@pytest.mark.slow
async def test_a_broker_that_forgets_and_a_consumer_that_comes_late(
    make_mosquitto: Callable[..., Mosquitto], resting: Workbench
) -> None:
    """No PUBACK says that a point has arrived anywhere."""
    broker = make_mosquitto()
    resting.port = broker.port
    resting.write_daemon()
    async with measuring(resting) as (listener, _, _):
        keys = await take(listener, 8)
        await until(lambda: all(row[2] for row in on_disk(resting)), "PUBACKs")
        broker.kill()
        broker.start()
        async with listening(resting.host, resting.port, resting.arm) as late:
            await late.ready()
            answer = await late.command(ResendArgs(), "which")
            (session,) = answer.result["sessions"]
            name = session["session"]
            assert (session["first_seq"], session["last_seq"]) == (0, 7)
            words = ("points", "resend", name, "--arm-name", resting.arm, "--from", "2")
            address = f"{resting.host}:{resting.port}"
            with Program(
                resting.folder, "resend", *words, "--broker", address, "--json"
            ) as resend:
                assert await resend.ended() == 0
                assert json.loads(resend.output)["points"] == 6
            await late.n_points(6)
            assert [(p.session, p.seq) for p in late.points] == keys[2:]
            assert {p.id: p for p in late.points}.items() <= {
                p.id: p for p in listener.points
            }.items()


async def test_a_daemon_killed_before_the_broker_has_its_points(
    make_mosquitto: Callable[..., Mosquitto], resting: Workbench
) -> None:
    broker = make_mosquitto()
    resting.port = broker.port
    resting.write_simulator(SPHERE.format(points=4), top="repeat = true")
    resting.write_daemon()
    with resting.simulator() as simulator:
        await simulator.says("ready base")
        with resting.daemon() as daemon:
            async with listening(resting.host, resting.port, resting.arm) as listener:
                await listener.ready()
                await listener.n_points(2)
            broker.kill()
            await daemon.says("broker.lost")
            n_before = len(on_disk(resting))
            await until(lambda: len(on_disk(resting)) >= n_before + 5, "points on disk")
            daemon.process.kill()
            await daemon.ended()
        left = [(s, n) for s, n, is_sent in on_disk(resting) if not is_sent]
        assert len(left) >= 5
        broker.start()
        async with listening(resting.host, resting.port, resting.arm) as listener:
            with resting.daemon(name="next") as daemon:
                await listener.n_points(len(left) + 2)
                assert await daemon.stop() == 0
        assert await simulator.stop() == 0
    keys = [(p.session, p.seq) for p in listener.points]
    assert keys[: len(left)] == left
    new = keys[len(left) :]
    assert new == [(new[0][0], n) for n in range(len(new))]
    by_session: dict[str, list[int]] = {}
    for session, seq, _ in on_disk(resting):
        by_session.setdefault(session, []).append(seq)
    assert len(by_session) == 2
    for numbers in by_session.values():
        assert numbers == list(range(len(numbers)))
    assert len({p.id for p in listener.points}) == len(listener.points)


@pytest.mark.slow
async def test_a_request_that_is_repeated_after_a_crash_takes_no_second_point(
    mosquitto: Mosquitto, resting: Workbench
) -> None:
    """Its requester does not know whether it was executed, and sends it again."""
    requests: dict[str, Args] = {
        "a latch": PointArgs(),
        "a mean": PointArgs(samples=5),
        "an undo": UndoArgs(),
    }
    resting.write_daemon()
    with resting.simulator() as simulator:
        await simulator.says("ready base")
        answers = []
        for life in ("first", "second"):
            async with listening(resting.host, resting.port, resting.arm) as listener:
                with resting.daemon(name=life) as daemon:
                    await daemon.says("arm")
                    await listener.ready()
                    for request, args in requests.items():
                        answers.append(await listener.command(args, request))
                    daemon.process.kill()
                    await daemon.ended()
        assert await simulator.stop() == 0
    assert answers[:3] == answers[3:]
    assert all(answer.ok for answer in answers)
    assert answers[1].result["samples"] == 5
    assert answers[2].result["retracts"] == answers[1].result["id"]
    assert [seq for _, seq, _ in on_disk(resting)] == [0, 1, 2]


@pytest.mark.slow
async def test_one_damaged_row_costs_that_point_only(
    make_mosquitto: Callable[..., Mosquitto], resting: Workbench
) -> None:
    """One byte that is no UTF-8, in a point that waits for the broker."""
    broker = make_mosquitto()
    resting.port = broker.port
    resting.write_simulator(SPHERE.format(points=4), top="repeat = true")
    resting.write_daemon()
    with resting.simulator() as simulator:
        await simulator.says("ready base")
        with resting.daemon() as daemon:
            await daemon.says("button.released")
            broker.kill()
            n_before = len(on_disk(resting))
            await until(lambda: len(on_disk(resting)) >= n_before + 6, "points")
            daemon.process.kill()
            await daemon.ended()
        left = [(s, n) for s, n, is_sent in on_disk(resting) if not is_sent]
        file = resting.folder / "state" / "outbox.db"
        session, seq = left[2]
        with contextlib.closing(sqlite3.connect(file)) as connection, connection:
            connection.execute(
                "UPDATE messages SET topic = CAST(x'74ff' AS TEXT) WHERE seq = ?", [seq]
            )
        broker.start()
        async with listening(resting.host, resting.port, resting.arm) as listener:
            with resting.daemon(name="next") as daemon:
                await listener.n_points(len(left) + 1)
                event = await listener.event("outbox.damaged")
                assert f"seq {seq} of session '{session}'" in event.text
                answer = await listener.command(ResendArgs(session=session))
                assert answer.result["points"] == answer.result["last_seq"]
                assert await daemon.stop() == 0
            assert listener.events_of("outbox.failed") == []
    keys = [(p.session, p.seq) for p in listener.points]
    assert keys[: len(left) - 1] == [*left[:2], *left[3:]]
    words = ("points", "export", "--db", str(file), "--out", "points.csv")
    with Program(resting.folder, "export", *words) as export:
        assert await export.ended() == 1
        assert f"seq {seq}: damaged, and left out" in export.log


async def test_a_second_daemon_on_the_same_folder_is_refused(
    resting: Workbench,
) -> None:
    async with measuring(resting) as (listener, _, _):
        with resting.daemon(name="second") as second:
            assert await second.ended() == 3  # the unit tries again
            assert "another daemon uses this state folder" in second.log
        assert await take(listener, 1)


# -- disks --------------------------------------------------------------------


class SmallDisk:
    """A file system of a few hundred kB, mounted where the daemon keeps its state."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(exist_ok=True)

    def mount(self, options: str) -> None:
        words = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(self.folder)]
        subprocess.run(words, check=True, capture_output=True)

    def fill(self) -> None:
        with contextlib.suppress(OSError), (self.folder / "ballast").open("wb") as file:
            while True:
                file.write(bytes(4096))
                file.flush()

    def empty(self) -> None:
        (self.folder / "ballast").unlink()


@pytest.fixture
def disk(resting: Workbench) -> Iterator[SmallDisk]:
    if os.geteuid() != 0:
        pytest.skip("mounting a file system needs root")
    disk = SmallDisk(resting.folder / "state")
    try:
        disk.mount("size=600k")
    except subprocess.CalledProcessError as error:
        pytest.skip(f"this system mounts nothing: {error.stderr!r}")
    yield disk
    subprocess.run(["umount", "-l", str(disk.folder)], check=True)


@contextlib.asynccontextmanager
async def refusing(listener: Listener) -> AsyncIterator[None]:
    """Points are refused with a reason in the block, and taken after it."""
    event = await listener.event("outbox.failed", active=True)
    assert event.remedy
    answer = await listener.command(PointArgs())
    assert answer.error is not None
    assert answer.error.code == "outbox.failed"
    assert answer.error.remedy
    await until(lambda: listener.healths[-1].outbox.state == "failed", "health says so")
    assert listener.statuses[-1].state == "degraded"
    yield
    await listener.event("outbox.failed", active=False)
    await listener.ready()
    assert await take(listener, 3)


async def test_a_full_disk_refuses_points_says_so_and_is_over(
    disk: SmallDisk, resting: Workbench
) -> None:
    async with measuring(resting) as (listener, _, _):
        acknowledged = await take(listener, 3)
        disk.fill()
        while True:  # the log may have some room left
            answer = await listener.command(PointArgs())
            if answer.error is not None:
                break
            acknowledged.append((answer.result["session"], answer.result["seq"]))
        async with refusing(listener):
            disk.empty()
        n = len(acknowledged) + 3
        await listener.n_points(n)
    seqs = [seq for _, seq in sorted({(p.session, p.seq) for p in listener.points})]
    assert seqs == list(range(n))
    assert [row[1] for row in on_disk(resting)] == seqs


@pytest.mark.slow
async def test_a_read_only_disk_at_the_start_is_reported_and_is_over(
    disk: SmallDisk, resting: Workbench
) -> None:
    async with measuring(resting) as (listener, _, daemon):
        before = await take(listener, 2)
        assert await daemon.stop(signal.SIGKILL) == -signal.SIGKILL
        disk.mount("remount,ro")
        listener.statuses.clear()
        with resting.daemon(name="next") as following:
            async with refusing(listener):
                disk.mount("remount,rw")
            assert await following.stop() == 0
    numbers = [(session, seq) for session, seq, _ in on_disk(resting)]
    assert numbers[:2] == before
    assert [seq for _, seq in numbers[2:]] == [0, 1, 2]
