"""`traverse gateway lines` as a program: refused options, kills, restarts."""

import asyncio
import itertools
import os
import random
import shlex
import socket
import uuid
from pathlib import Path

import pytest

from tests.cli.programs import run_traverse
from tests.client.virtual_daemon import VirtualDaemon
from tests.end_to_end.programs import Program, until
from tests.mosquitto import Mosquitto
from traverse.client.cancel_tasks import cancel_tasks

LINES = ("gateway", "lines")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("", "give one of --tcp, --udp, --serial and --file"),
        ("--tcp 1 --file a", "give one of --tcp, --udp, --serial and --file"),
        ("--tcp x", "--tcp x: expected HOST:PORT"),
        ("--tcp 65536", "--tcp 65536: expected HOST:PORT, with a port to 65535"),
        ("--udp 5000", "--udp 5000: expected HOST:PORT"),
        ("--file no/lines.txt", "name a file in a folder that is there"),
        ("--file .", "name a file in a folder that is there"),
        ("--file a --template {w}", "{w} is no value of a point; there are: x, y"),
        ("--file a --template {x:d}", "Unknown format code 'd'"),
        ("--file a --decimal ,", "',' is the decimal sign and stands between values"),
        ("--file a --kind scans --coordinates surface", "has no --coordinates surface"),
        ("--file a --cursor-file bad.json", "bad.json: []; expected a map with schema"),
    ],
)
def test_bad_options_are_refused_in_a_sentence(
    words: str, expected: str, tmp_path: Path
) -> None:
    (tmp_path / "bad.json").write_text("[]")
    result = run_traverse(tmp_path, *LINES, "--arm", "bench-7", *shlex.split(words))
    assert result.returncode == 2, result.stderr
    assert expected in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_a_port_that_is_taken_is_refused(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        result = run_traverse(tmp_path, *LINES, "--arm", "bench-7", "--tcp", port)
    assert result.returncode == 2
    assert (
        f"tcp 127.0.0.1:{port}: Address already in use; name another" in result.stderr
    )


def test_a_broker_that_is_not_there_has_a_status_of_its_own(tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
        options = ("--broker", f"127.0.0.1:{port}", "--file", "lines.txt")
        result = run_traverse(tmp_path, *LINES, "--arm", "bench-7", *options)
    assert result.returncode == 3


@pytest.mark.needs("mosquitto")
async def test_no_point_is_lost_however_often_the_gateway_is_killed(
    mosquitto: Mosquitto, tmp_path: Path
) -> None:
    random.seed(7)
    n_points, n_kills = 400, 6
    virtual = VirtualDaemon(
        f"arm-{uuid.uuid4().hex[:8]}", mosquitto.host, mosquitto.port
    )
    broker = f"{mosquitto.host}:{mosquitto.port}"
    options = ("--arm", virtual.arm, "--broker", broker, "--file", "lines.txt")
    chosen = ("--template", r"{seq} {ok}\n", "--cursor-file", "place.json")
    command = (*LINES, *options, *chosen, "--since", "session")
    path = tmp_path / "lines.txt"

    def seqs() -> list[int]:
        found = path.read_text().splitlines() if path.exists() else []
        return [int(line.split()[0]) for line in found]

    async def measure() -> None:
        for _ in range(n_points):
            await virtual.take()
            await asyncio.sleep(0.005)

    async with virtual.running():
        measuring = asyncio.create_task(measure())
        for number in range(n_kills):
            before = len(seqs())
            with Program(tmp_path, f"gateway-{number}", *command) as gateway:
                more = random.randint(1, 40)
                await until(lambda: len(seqs()) >= before + more, "more lines")  # noqa: B023
                os.kill(gateway.process.pid, 9)
                await gateway.ended()
        with Program(tmp_path, "gateway", *command) as gateway:
            await until(lambda: n_points - 1 in seqs(), "the last point")
            await measuring
            assert await gateway.stop() == 0
        await cancel_tasks([measuring])
    found = seqs()
    assert sorted(set(found)) == list(range(n_points))
    # What is repeated after a kill is part of the last write.
    again = sum(seq <= before for before, seq in itertools.pairwise(found))
    assert again <= n_kills
    assert "0 lost" in gateway.log.splitlines()[-1]
