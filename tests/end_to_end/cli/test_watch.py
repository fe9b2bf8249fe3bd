import asyncio
import contextlib
import os
import shlex
import signal
import sys

import pytest

from tests.client.virtual_daemon import VirtualDaemon
from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import Workbench
from tests.mosquitto import HOST, free_port
from tests.running import run_program
from traverse.protocol.encoding import decode
from traverse.protocol.messages import Point, PointArgs, Status
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")


def watch(bench: Workbench, *options: str) -> Program:
    where = ("--broker", f"{bench.host}:{bench.port}", "--arm-name", bench.arm)
    return Program(bench.folder, "watch", "watch", *where, *options)


def watched_by_head(bench: Workbench) -> tuple[str, str]:
    """Output and errors of a pipeline whose second program takes one line."""
    where = ("--broker", f"{bench.host}:{bench.port}", "--arm-name", bench.arm)
    command = shlex.join((sys.executable, "-m", "traverse", "watch", *where))
    ended = run_program("sh", "-c", f"{command} | head -n 1")
    return ended.stdout, ended.stderr


async def test_lines_tell_status_health_and_points_with_units(
    resting: Workbench,
) -> None:
    async with measuring(resting) as (listener, _, _):
        with watch(resting) as watching:
            await watching.says("status ready; base ready")
            await watching.says("samples/s, broker connected")
            await listener.command(PointArgs())
            await watching.says("point     0")
            assert await watching.stop(signal.SIGINT) == 0
            lines = watching.output.splitlines()
            assert all(line.startswith(f"{resting.arm}  ") for line in lines)
            (point,) = [line for line in lines if " point " in line]
            assert point.endswith(" mm")
            assert watching.log == ""


async def test_json_lines_are_messages(resting: Workbench) -> None:
    async with measuring(resting) as (listener, _, _):
        with watch(resting, "--json", "--kinds", "status,point") as watching:
            await watching.says("traverse/status/1")
            await listener.command(PointArgs())
            await watching.says("traverse/point/1")
            assert await watching.stop(signal.SIGINT) == 0
            first, *lines = watching.output.splitlines()
    assert decode(Status, first.encode(), "json").arm == resting.arm
    (point,) = [line for line in lines if '"traverse/point/1"' in line]
    assert decode(Point, point.encode(), "json") == listener.points[0]


@pytest.mark.slow
async def test_an_arm_that_is_not_there_is_reported_and_waited_for(
    resting: Workbench,
) -> None:
    other = VirtualDaemon(f"{resting.arm}-other", resting.host, resting.port)
    where = ("--broker", f"{resting.host}:{resting.port}", "--arm-name", resting.arm)
    words = (*where, "--port", str(free_port()))
    async with other.running():
        with (
            watch(resting) as watching,
            Program(resting.folder, "page", "page", *words) as page,
        ):
            for program in (watching, page):
                await program.says("Ctrl-C ends")
                assert f"no arm named {resting.arm} has been heard" in program.log
                assert other.arm in program.log.partition("arms there: ")[2]
            async with measuring(resting):
                await watching.says("status ready; base ready")
            for program in (watching, page):
                await program.stop(signal.SIGINT)
                assert program.log.count("has been heard") == 1


async def test_a_broker_that_is_not_there_is_told(resting: Workbench) -> None:
    resting.host, resting.port = HOST, free_port()
    with watch(resting) as watching:
        assert await watching.ended() == 3
        assert f"broker {HOST}:{resting.port}" in watching.log
        assert "Traceback" not in watching.log


async def test_an_unknown_kind_is_refused(resting: Workbench) -> None:
    with watch(resting, "--kinds", "points") as watching:
        assert await watching.ended() == 2
        assert "points is none of" in watching.log


@pytest.mark.slow
async def test_it_ends_when_nobody_reads_its_lines_any_more(resting: Workbench) -> None:
    async with measuring(resting):
        out, err = await asyncio.to_thread(watched_by_head, resting)
    assert len(out.splitlines()) == 1
    assert err == ""


@pytest.mark.slow
async def test_on_a_terminal_it_is_a_display(resting: Workbench) -> None:
    where = ("--broker", f"{resting.host}:{resting.port}")
    command = [
        sys.executable,
        "-m",
        "traverse",
        "watch",
        *where,
        "--arm-name",
        resting.arm,
    ]
    ours, theirs = os.openpty()
    screen = b""
    async with measuring(resting) as (listener, _, _):
        process = await asyncio.create_subprocess_exec(
            *command, stdout=theirs, stderr=theirs
        )
        try:
            os.close(theirs)
            os.set_blocking(ours, False)

            def shows(text: bytes) -> bool:
                nonlocal screen
                with contextlib.suppress(OSError):
                    screen += os.read(ours, 1 << 20)
                return text in screen

            await until(lambda: shows(b"Ready to measure."), "a display")
            await listener.command(PointArgs())
            await until(lambda: shows(b"1 point"), "the point on the display")
            process.send_signal(signal.SIGINT)
            await until(
                lambda: shows(b"") and process.returncode is not None, "its end"
            )
            assert process.returncode == 0
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
    os.close(ours)
