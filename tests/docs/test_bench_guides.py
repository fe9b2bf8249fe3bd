import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.docs.accounts import why_not_run
from tests.docs.pages import commands
from tests.docs.shell import Shell, answered, as_run
from tests.end_to_end.workbench import SPHERE, Workbench
from tests.mosquitto import Mosquitto

CONNECT = "docs/how-to/connect-a-board.md"
READ = "docs/how-to/read-points-in-your-program.md"
OTHERS = (
    READ,
    "docs/how-to/record-and-replay.md",
    "docs/how-to/export-points.md",
    "docs/how-to/points-as-lines.md",
    "docs/how-to/metrology-software.md",
)
BY_HAND = "reply/#|by-hand-1"
"""What listens for a reply, and the command that is replied to: run together."""
ENDLESS = {
    "traverse run": "arm bench-7",
    "traverse watch": '"arm":"bench-7"',
    "traverse gateway ippdme": "I++ DME server of bench-7 on",
    "traverse gateway": "points of bench-7 to",
}
"""Commands that do not end, and what they say first."""
SCAN = (
    "mosquitto_pub -q 1 -t traverse/bench-7/cmd/scan -m "
    '\'{"schema":"traverse/command/1","request":"s","args":{"action":"start"}}\''
)
HERE = {
    "mosquitto_sub -t": "mosquitto_sub -C 1 -t",
    "0.0.0.0:1294 --probes probes.toml": "127.0.0.1:0",
    "--seconds 60": "--seconds 2",
    "monday.mcap": "state/recordings/bumps.mcap",
    "replay bumps.mcap": "replay state/recordings/bumps.mcap",
    '"from_seq":17': '"from_seq":0',
    "--from 17": "--from 0",
}
"""What is named otherwise on this bench."""


async def first_said(bench: Workbench, line: str) -> str:
    """Output of a command; all of it where it ends by itself."""
    with Shell(bench.folder, "shown", as_run(line, bench.port)) as shell:
        for words, expected in ENDLESS.items():
            if words in line:
                await shell.says(expected)
                return shell.output
        return await shell.ends()


def to_run(page: str, **names: str) -> list[str]:
    lines = [line for line in commands(page) if why_not_run(line) is None]
    for shown, ours in (HERE | names).items():
        lines = [line.replace(shown, ours) for line in lines]
    assert lines
    return lines


@pytest.mark.slow
@pytest.mark.needs("mosquitto", "jq")
async def test_every_command_of_the_guides(
    make_mosquitto: Callable[..., Mosquitto], tmp_path: Path
) -> None:
    broker = make_mosquitto()
    bench = Workbench(tmp_path, broker.host, broker.port, "bench-7")
    bench.write_simulator(SPHERE.format(points=500))
    bench.write_daemon(broker='encoding = "json"')
    with bench.simulator() as simulator:
        await simulator.says("ready base")
        check, run, watch = to_run(CONNECT)
        assert "valid arm file" in await first_said(bench, check)
        await first_said(bench, run)
        with bench.daemon() as daemon:
            await daemon.says("button.pressed")
            await first_said(bench, watch)
            status = await first_said(
                bench, "mosquitto_sub -C 1 -t 'traverse/+/status'"
            )
            session = json.loads(status)["session"]
            by_hand = [line for line in to_run(READ) if re.search(BY_HAND, line)]
            listen, point = by_hand
            listen = listen.replace("-C 1", "").rstrip("& ")
            with Shell(tmp_path, "heard", as_run(listen, bench.port)) as listener:
                await answered(as_run(point, bench.port), listener, '"by-hand-1"')
            await first_said(bench, SCAN)
            for page in OTHERS:
                for line in to_run(page, **{"5c1f...": session}):
                    if not re.search(BY_HAND, line):
                        await first_said(bench, line)
            assert await daemon.stop() == 0
    suffixes = {path.suffix for path in (tmp_path / "state").rglob("*")}
    assert (tmp_path / "points.csv").read_text("utf-8").count("\n") > 2
    assert {".mcap", ".db", ".csv"} <= suffixes
