"""`python -m benchmarks.fleet`: many arms, one mosquitto, a group of three consumers.

First arms without daemons (one process with a connection for each), then real daemons
on simulated boards. Every point and every point of a scan has to reach exactly one
consumer. Shares are of one core.
"""

import argparse
import contextlib
import functools
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from benchmarks.fleet.daemons import run_daemons
from benchmarks.fleet.tally import Cost, Fleet, Group, Run, Sent, cost_of, tally
from benchmarks.tools import rig
from benchmarks.tools.rounds import load, write_json
from benchmarks.tools.sizes import sized

CONSUMERS = 3
SETTLE_S = 1.5


def _is_ready(log: Path) -> bool:
    return b"ready" in log.read_bytes()


@contextlib.contextmanager
def group(folder: Path, port: int) -> Iterator[Group]:
    with contextlib.ExitStack() as stack:
        processes, files = [], []
        for k in range(CONSUMERS):
            log, file = folder / f"consumer-{k}.log", folder / f"consumer-{k}.json"
            run = (sys.executable, "-m", "benchmarks.fleet.consumer")
            name = f"consumer-{k}"
            processes.append(
                stack.enter_context(rig.program(log, *run, str(port), name, str(file)))
            )
            files.append(file)
            rig.wait_for(functools.partial(_is_ready, log), name)
        yield Group(processes, files)


def run_publishers(folder: Path, n: int, rate_hz: float, seconds: float) -> Fleet:
    port, sent = rig.free_port(), folder / "sent.json"
    with rig.mosquitto(folder, port) as broker:
        idle_mb = rig.rss_mb(broker)
        with group(folder, port) as consumers:
            run = (sys.executable, "-m", "benchmarks.fleet.publishers", str(port))
            arguments = (str(n), str(rate_hz), str(seconds), str(sent))
            begun_s = time.monotonic()
            before = Cost.of(broker, consumers.processes)
            with rig.program(folder / "publishers.log", *run, *arguments) as process:
                process.wait(seconds + 60)
            time.sleep(SETTLE_S)
            taken_s = time.monotonic() - begun_s
            cost = cost_of(before, broker, consumers.processes, taken_s)
            broker_mb = rig.rss_mb(broker) - idle_mb
            consumers.end()
        totals = json.loads(sent.read_text("utf-8"))
        expected = {
            (arm, kind): count
            for arm, counts in totals["sent"].items()
            for kind, count in counts.items()
        }
        return tally(
            Run("publishers", n, rate_hz, seconds),
            Sent(expected, totals["latest_s"]),
            consumers,
            shares=cost,
            broker_mb=broker_mb,
        )


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fleet")
    parser.add_argument(
        "--arms", type=int, default=sized(50, 2), help="without daemons"
    )
    parser.add_argument(
        "--daemons", default=sized("1,4,8,12", "1"), help="numbers of real daemons"
    )
    parser.add_argument("--rate", type=float, default=200.0, help="of each arm, Hz")
    parser.add_argument("--seconds", type=float, default=sized(30.0, 2.0))
    parser.add_argument("--out", type=Path, help="figures as JSON")
    options = parser.parse_args(arguments)
    print(f"{os.cpu_count()} cores, {load()}")
    rows = []
    with tempfile.TemporaryDirectory() as name:
        if options.arms:
            place = Path(name) / "publishers"
            place.mkdir()
            rows.append(
                run_publishers(place, options.arms, options.rate, options.seconds)
            )
            print(rows[-1].lines(), flush=True)
        for text in filter(None, options.daemons.split(",")):
            place = Path(name) / f"daemons-{text}"
            place.mkdir()
            rows.append(
                run_daemons(place, int(text), options.rate, options.seconds, group)
            )
            print(rows[-1].lines(), flush=True)
    write_json(options.out, [asdict(row) for row in rows])
    return int(any(row.missing or row.doubled for row in rows))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
