"""`make soak`: `python -m benchmarks.soak [--kills N] [--seed N] [--rate HZ]`.

The real daemon with mosquitto and the simulated board; points by the board's button and
by command, while daemon, broker, board, networks and consumer are killed at random.
Then disks that are full or read-only. Prints a table; exit status 1 where a point that
was acknowledged is missing, doubled, out of order, or invented, and where the daemon
was not at work for long enough to show anything.
"""

import argparse
import asyncio
import random
import shutil
import sys
import tempfile
import time
from contextlib import AsyncExitStack, ExitStack
from pathlib import Path

from benchmarks.soak import disk, witness
from benchmarks.soak.bench import Bench
from benchmarks.soak.judge import Span, Verdict, judge, outbox_points, stored
from benchmarks.soak.outages import Outages
from benchmarks.tools.rounds import load
from benchmarks.tools.sizes import sized

READY_S = 180.0
DRAIN_S = 120.0


async def crash(
    bench: Bench, outages: Outages, kills: int, has_disk: bool
) -> tuple[Span, list[str]]:
    """Run all outages; return their span, and failures with bad disks."""
    async with AsyncExitStack() as stack:
        await stack.enter_async_context(bench.daemons_network)
        await stack.enter_async_context(bench.consumers_network)
        bench.write_daemon()
        keeping = [asyncio.create_task(program.keep()) for program in bench.programs()]
        try:
            await _first_points(bench)
            begun_s = time.time()
            await outages.happen(kills, _log)
            span = Span(begun_s, time.time(), bench.daemon.starts)
            disk_faults = await _disks(bench) if has_disk else []
            for killed, task in zip(bench.programs(), list(keeping), strict=True):
                if killed in (bench.operator, bench.board):
                    task.cancel()
            bench.operator.stop()
            await asyncio.sleep(2.0)  # so that the last edges are acknowledged
            bench.board.stop()
            bench.is_quiet = True
            bench.witness.kill(0.0)  # it begins anew, and commands no more
            await _drained(bench)
        finally:
            for task in keeping:
                task.cancel()
            await asyncio.gather(*keeping, return_exceptions=True)
            for killed in reversed(list(bench.programs())):
                if killed.starts:
                    killed.stop()
    return span, disk_faults


def _log(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", flush=True)


async def _first_points(bench: Bench) -> None:
    async with asyncio.timeout(READY_S):
        while not _count(bench):  # noqa: ASYNC110 - a file of another program
            await asyncio.sleep(0.2)


async def _disks(bench: Bench) -> list[str]:
    faults = []
    troubles = {
        "full disk": disk.full(bench.state),
        "read-only disk": disk.read_only(bench.state, bench.daemon),
    }
    for name, trouble in troubles.items():
        _log(f"     {name}")
        bench.note_disk(is_sound=False)
        async with disk.arm_for(bench.port) as arm:
            faults += [f"{name}: {text}" for text in await disk.refusal(arm, trouble)]
        bench.note_disk(is_sound=True)
    return faults


async def _drained(bench: Bench) -> None:
    """Wait until neither store nor outbox changes."""
    quiet_since_s, last = time.monotonic(), -1
    until_s = time.monotonic() + DRAIN_S
    while time.monotonic() < until_s:
        now = _count(bench)
        is_whole = witness.seen(bench.witness_store)[0] == now == _in_outbox(bench)
        if now != last:
            quiet_since_s, last = time.monotonic(), now
        if time.monotonic() - quiet_since_s > 3.0 and is_whole:
            return
        await asyncio.sleep(0.5)


def _count(bench: Bench) -> int:
    path = bench.folder / "store.db"
    return len(stored(path)) if path.exists() and path.stat().st_size else 0


def _in_outbox(bench: Bench) -> int:
    return len(outbox_points(bench.state / "outbox.db"))


def table(
    bench: Bench, outages: Outages, verdict: Verdict, seconds: float, disks: str
) -> str:
    rows = [(f"outages: {kind}", n) for kind, n in sorted(outages.counts.items())]
    rows += [("outages in all", sum(outages.counts.values()))]
    rows += [
        (f"starts of {program.name}", program.starts) for program in bench.programs()
    ]
    rows += list(verdict.figures.items())
    width = max(len(name) for name, _ in rows)
    text = [f"{name:{width}}  {n:8d}" for name, n in rows]
    text.append(f"{'full and read-only disk':{width}}  {disks}")
    text.append(f"{'seconds':{width}}  {seconds:8.0f}")
    return "\n".join(text)


def main(options: argparse.Namespace) -> int:
    begun_s = time.monotonic()
    print(f"{load()}; seed {options.seed}", flush=True)
    with ExitStack() as stack:
        if options.folder is None:
            name = stack.enter_context(tempfile.TemporaryDirectory(prefix="soak-"))
            folder = Path(name)
        else:
            folder = options.folder
            folder.mkdir(parents=True)
        state = folder / "state"
        has_disk = stack.enter_context(disk.small_disk(state))
        bench = Bench(folder, state, options.rate)
        outages = Outages(bench, options.seed)
        span, disk_faults = asyncio.run(crash(bench, outages, options.kills, has_disk))
        outbox = state / "outbox.db"
        _, n_commanded = witness.seen(bench.witness_store)
        verdict = judge(folder, outbox, bench.lives, span, n_commanded)
        figures, foreign = witness.faults(bench.witness_store, outbox)
        verdict.figures.update(figures)
        verdict.faults.extend(foreign)
        if has_disk and options.folder is not None:
            shutil.copytree(state, folder / "kept")  # the disk itself disappears
    faults = disk_faults + verdict.faults
    disks = "refused, told, recovered" if has_disk else "not tried: mounting needs root"
    disks = "; ".join(disk_faults) or disks
    print(table(bench, outages, verdict, time.monotonic() - begun_s, disks))
    for fault in faults:
        print(f"FAULT: {fault}")
    print("FAILED" if faults else "every acknowledged point is there, once, in order")
    return 1 if faults else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak")
    parser.add_argument("--kills", type=int, default=sized(200, 1))
    parser.add_argument("--seed", type=int, default=random.randrange(10_000))
    parser.add_argument("--rate", type=float, default=10.0, help="commands a second")
    parser.add_argument("--folder", type=Path, help="keep everything there")
    sys.exit(main(parser.parse_args()))
