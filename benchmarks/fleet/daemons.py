"""Real daemons on simulated boards, each with its own folder, all at one broker."""

import asyncio
import contextlib
import dataclasses
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import aiomqtt

from benchmarks.fleet.tally import (
    Cost,
    Fleet,
    Group,
    Process,
    Run,
    Sent,
    cost_of,
    tally,
)
from benchmarks.tools import rig
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Command, ScanArgs
from traverse.protocol.topics import command_topic

AT_ONCE = 4  # that start together
SETTLE_S = 1.5

MakeGroup = Callable[[Path, int], AbstractContextManager[Group]]


def write_arm(folder: Path, number: int, port: int) -> Path:
    place = folder / str(number)
    place.mkdir()
    arm = rig.ARM.read_text("utf-8").replace('"demo-7"', f'"{name_of(number)}"')
    (place / "arm.toml").write_text(arm, "utf-8")
    text = rig.DAEMON.format(folder=place, port=port)
    (place / "daemon.toml").write_text(text, "utf-8")
    return place


def name_of(number: int) -> str:
    return f"arm-{number:03d}"


def own_mb(process: Process) -> float:
    """Return a program's private memory, and its part of shared memory."""
    text = Path(f"/proc/{process.pid}/smaps_rollup").read_text("ascii")
    line = next(entry for entry in text.splitlines() if entry.startswith("Pss:"))
    return int(line.split()[1]) * 1024 / 1e6


async def order(port: int, n: int, args: ScanArgs) -> None:
    async with aiomqtt.Client("127.0.0.1", port) as client:
        for k in range(n):
            command = Command.carrying(args, f"{args.action}-{k}")
            topic = command_topic(name_of(k), "scan")
            await client.publish(topic, encode(command, "msgpack"), qos=1)


def run_daemons(
    folder: Path, n: int, rate_hz: float, seconds: float, group: MakeGroup
) -> Fleet:
    port = rig.free_port()
    with contextlib.ExitStack() as stack:
        broker = stack.enter_context(rig.mosquitto(folder, port))
        idle_mb = rig.rss_mb(broker)
        places = [write_arm(folder, k, port) for k in range(n)]
        run = (sys.executable, "-m", "benchmarks.fleet.boards", str(folder), str(n))
        boards = stack.enter_context(rig.program(folder / "boards.log", *run))
        rig.wait_for((places[-1] / "board.pty").exists, "the boards")
        begun_s = time.monotonic()
        daemons = [start(stack, places, k) for k in range(n)]
        rig.wait_for(lambda: all(map(measures, places)), "all daemons", 30 + 5 * n)
        start_s = time.monotonic() - begun_s
        with group(folder, port) as consumers:
            asyncio.run(order(port, n, ScanArgs(action="start", rate_hz=rate_hz)))
            time.sleep(SETTLE_S)
            processes = [*daemons, boards]
            cpu_s = [rig.cpu_s(process) for process in processes]
            before = Cost.of(broker, consumers.processes)
            begun_s = time.monotonic()
            time.sleep(seconds)
            taken_s = time.monotonic() - begun_s
            shares = cost_of(before, broker, consumers.processes, taken_s)
            used = [
                (rig.cpu_s(process) - old_s) / taken_s
                for process, old_s in zip(processes, cpu_s, strict=True)
            ]
            resident = sum(map(rig.rss_mb, daemons)) / n
            daemons_mb = sum(map(own_mb, daemons)) / n
            broker_mb = rig.rss_mb(broker) - idle_mb
            asyncio.run(order(port, n, ScanArgs(action="stop")))
            time.sleep(SETTLE_S)
            consumers.end()
        fleet = tally(
            Run("daemons", n, rate_hz, seconds),
            Sent({}),
            consumers,
            shares=shares,
            broker_mb=broker_mb,
        )
    return dataclasses.replace(
        fleet,
        daemon_share=sum(used[:n]) / n,
        daemon_mb=resident,
        daemon_own_mb=daemons_mb,
        boards_share=used[n],
        start_s=start_s,
    )


def start(stack: contextlib.ExitStack, places: list[Path], number: int) -> Process:
    """Start a daemon when no more than a few others are starting."""

    def few_are_starting() -> bool:
        return sum(not measures(place) for place in places[:number]) < AT_ONCE

    rig.wait_for(few_are_starting, f"the daemons before number {number}", 120)
    config = str(places[number] / "daemon.toml")
    run = (sys.executable, "-m", "traverse", "run", config)
    return stack.enter_context(rig.program(places[number] / "daemon.log", *run))


def measures(place: Path) -> bool:
    log = place / "daemon.log"
    return log.exists() and b"arm arm-" in log.read_bytes()
