import asyncio
import itertools
import json
import os
import random
import shlex
import signal
import socket
import uuid
from pathlib import Path

import aiomqtt
import pytest
from asyncua import Client

from tests.client.gateways.foxglove_viewer import Viewer
from tests.client.virtual_daemon import VirtualDaemon
from tests.end_to_end.programs import Program
from tests.mosquitto import Mosquitto, free_port
from tests.running import invoke, run_traverse
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.gateways.opcua import NAMESPACE
from traverse.lab.daily_check.figures import DailyCheckFigures
from traverse.lab.daily_check.history import Check, add_check
from traverse.testing.waiting import until

LINES = ("gateway", "lines")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("lines", "give one of --tcp, --udp, --serial and --file"),
        ("lines --tcp 1 --file a", "give one of --tcp, --udp, --serial and --file"),
        ("lines --tcp x", "--tcp x: expected HOST:PORT"),
        ("lines --tcp 65536", "--tcp 65536: expected HOST:PORT, with a port to 65535"),
        ("lines --udp 5000", "--udp 5000: expected HOST:PORT"),
        ("lines --file no/lines.txt", "name a file in a folder that is there"),
        ("lines --file .", "name a file in a folder that is there"),
        (
            "lines --file a --template {w}",
            "{w} is no value of a point; there are: x, y",
        ),
        ("lines --file a --template {x:d}", "Unknown format code 'd'"),
        (
            "lines --file a --decimal ,",
            "',' is the decimal sign and stands between values",
        ),
        (
            "lines --file a --kind scans --coordinates surface",
            "has no --coordinates surface",
        ),
        (
            "lines --file a --cursor-file bad.json",
            "bad.json: []; expected a map with schema",
        ),
        ("ippdme --listen x", "--listen x: expected HOST:PORT, with a port to 65535"),
        ("ippdme --key base/1", "--key base/1: expected INPUT=NAME, such as base/1="),
        ("home-assistant --arm-name a/b", "arm name: 'a/b'; expected 1 to 64 charact"),
        (
            "home-assistant --prefix home/#",
            "--prefix home/#: expected a topic, without + and",
        ),
        ("home-assistant --history no.db", "--history no.db: there is no such file"),
        ("home-assistant --history x.db", "x.db: is no history of checks"),
    ],
)
def test_bad_options_are_refused_in_a_sentence(
    words: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bad.json").write_text("[]")
    (tmp_path / "x.db").write_text("x" * 1000)
    kind, *options = shlex.split(words)
    monkeypatch.chdir(tmp_path)
    result = invoke("gateway", kind, "--arm-name", "bench-7", *options, status=2)
    assert expected in result.stderr
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.needs("mosquitto")
async def test_an_arm_is_shown_in_home_assistant_and_taken_out(
    mosquitto: Mosquitto, tmp_path: Path
) -> None:
    where = ("--broker", f"{mosquitto.host}:{mosquitto.port}")
    virtual = VirtualDaemon(
        f"arm-{uuid.uuid4().hex[:8]}", mosquitto.host, mosquitto.port
    )
    checked = "2026-11-23T06:10:00Z"
    figures = DailyCheckFigures(**dict.fromkeys(DailyCheckFigures.__annotations__, 0.0))
    add_check(tmp_path / "interim.db", Check(checked, virtual.arm, "", "", "", figures))
    options = ("gateway", "home-assistant", "--arm-name", virtual.arm, *where)
    seen: dict[str, str] = {}

    async def follow(client: aiomqtt.Client) -> None:
        await client.subscribe(f"home/device/traverse_{virtual.arm}/+")
        async for message in client.messages:
            assert isinstance(message.payload, bytes)
            seen[str(message.topic).split("/")[-1]] = message.payload.decode()

    async with (
        virtual.running(),
        aiomqtt.Client(mosquitto.host, mosquitto.port) as client,
    ):
        following = asyncio.create_task(follow(client))
        words = (*options, "--prefix", "home", "--history", "interim.db")
        with Program(tmp_path, "shown", *words) as gateway:
            await until(lambda: seen.get("availability") == "online", "it is shown")
            assert json.loads(seen["state"])["last_check"] == checked
            assert "last_check" in json.loads(seen["config"])["components"]
            assert await gateway.stop() == 0
        await until(lambda: seen["availability"] == "offline", "it has ended")
        with Program(tmp_path, "removed", *options, "--prefix=home", "--remove") as end:
            assert await end.ended() == 0
        await until(lambda: not any(seen.values()), "nothing is retained")
        await cancel_tasks([following])


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("--separator comma --decimal ,", "',' is the decimal sign and stands between"),
        ("--through uinput --separator semicolon", "has another key in each layout"),
        ("", "no desktop can be reached (DISPLAY is None); run this in the operator's"),
    ],
)
def test_keys_that_cannot_be_typed_are_refused_in_a_sentence(
    words: str, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    options = ("--arm-name", "bench-7", *shlex.split(words))
    result = invoke("gateway", "keys", *options, status=2)
    assert expected in result.stderr
    assert len(result.stderr.splitlines()) == 1


def options_of_a_server(
    kind: str, scheme: str, virtual: VirtualDaemon, mosquitto: Mosquitto, folder: Path
) -> tuple[str, tuple[str, ...]]:
    """Refuse a port that is taken; return it, free now, and options with it."""
    with socket.create_server(("127.0.0.1", 0)) as occupied:
        port = str(occupied.getsockname()[1])
        broker = f"{mosquitto.host}:{mosquitto.port}"
        options = ("--arm-name", virtual.arm, "--broker", broker, "--listen", port)
        result = run_traverse(folder, "gateway", kind, *options, status=2)
    assert f"{scheme}127.0.0.1:{port}: " in result.stderr
    assert result.stderr.endswith("name another port\n")
    return port, options


@pytest.fixture
def unseen(mosquitto: Mosquitto) -> VirtualDaemon:
    name = f"arm-{uuid.uuid4().hex[:8]}"
    return VirtualDaemon(name, mosquitto.host, mosquitto.port)


@pytest.mark.needs("mosquitto")
async def test_the_live_view_as_a_program(
    unseen: VirtualDaemon, mosquitto: Mosquitto, tmp_path: Path
) -> None:
    port, options = options_of_a_server("live", "ws://", unseen, mosquitto, tmp_path)
    async with unseen.running():
        await unseen.take(2)
        with Program(tmp_path, "live", "gateway", "live", *options) as program:
            await until(lambda: "open it in Foxglove" in program.log, "the server")
            async with Viewer(f"ws://127.0.0.1:{port}") as viewer:
                shown = viewer.messages
                await until(
                    lambda: any(
                        len(m.get("entities", ())) == 2 for m in shown.get("points", ())
                    ),
                    "both points of the session",
                )
            assert await program.stop() == 0
    assert program.log.splitlines()[-1] == "2 points shown"


class Sequences:
    """Called by a client of OPC UA with the numbers of points."""

    def __init__(self) -> None:
        self.received: list[int] = []

    def datachange_notification(self, _node: object, value: int, _data: object) -> None:
        self.received.append(value)


@pytest.mark.slow
@pytest.mark.needs("mosquitto")
async def test_the_opc_ua_server_as_a_program(
    unseen: VirtualDaemon, mosquitto: Mosquitto, tmp_path: Path
) -> None:
    port, options = options_of_a_server("opcua", "tcp ", unseen, mosquitto, tmp_path)
    async with unseen.running():
        with Program(tmp_path, "opcua", "gateway", "opcua", *options) as program:
            await until(lambda: "for clients of OPC UA" in program.log, "the server")
            async with Client(f"opc.tcp://127.0.0.1:{port}/") as client:
                index = await client.get_namespace_index(NAMESPACE)
                path = [
                    f"{index}:{name}" for name in (unseen.arm, "LastPoint", "Sequence")
                ]
                numbers = Sequences()
                subscription = await client.create_subscription(20, numbers)
                sequence = await client.nodes.objects.get_child(path)
                await subscription.subscribe_data_change(sequence)
                await unseen.take(2)
                await until(lambda: numbers.received[-1:] == [1], "the second point")
            assert await program.stop() == 0
    assert program.log.splitlines()[-1] == "2 points shown"


def test_a_port_that_is_taken_is_refused(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as occupied:
        port = str(occupied.getsockname()[1])
        words = (*LINES, "--arm-name", "bench-7", "--tcp", port)
        result = run_traverse(tmp_path, *words, status=2)
    assert (
        f"tcp 127.0.0.1:{port}: Address already in use; name another" in result.stderr
    )


def test_a_broker_that_is_not_there_has_a_status_of_its_own(tmp_path: Path) -> None:
    options = ("--broker", f"127.0.0.1:{free_port()}", "--file", "lines.txt")
    run_traverse(tmp_path, *LINES, "--arm-name", "bench-7", *options, status=3)


@pytest.mark.slow
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
    options = ("--arm-name", virtual.arm, "--broker", broker, "--file", "lines.txt")
    chosen = ("--template", r"{seq} {ok}\n", "--cursor-file", "place.json")
    command = (*LINES, *options, *chosen, "--since", "session")
    path = tmp_path / "lines.txt"

    def seqs() -> list[int]:
        typed = path.read_text().splitlines() if path.exists() else []
        return [int(line.split()[0]) for line in typed]

    async def measure() -> None:
        for _ in range(n_points):
            await virtual.take()
            await asyncio.sleep(0.005)

    async with virtual.running():
        measuring = asyncio.create_task(measure())
        for number in range(n_kills):
            n_before = len(seqs())
            with Program(tmp_path, f"gateway-{number}", *command) as gateway:
                goal = n_before + random.randint(1, 40)
                await until(lambda n=goal: len(seqs()) >= n, "more lines")
                os.kill(gateway.process.pid, 9)
                await gateway.ended()
        with Program(tmp_path, "gateway", *command) as gateway:
            await until(lambda: n_points - 1 in seqs(), "the last point")
            await measuring
            # It may end before it has begun: the one before had the last point.
            assert await gateway.stop() in (0, -signal.SIGTERM)
        await cancel_tasks([measuring])
    sent_seqs = seqs()
    assert sorted(set(sent_seqs)) == list(range(n_points))
    # What is repeated after a kill is part of the last write.
    n_repeated = sum(seq <= before for before, seq in itertools.pairwise(sent_seqs))
    assert n_repeated <= n_kills
    assert "0 lost" in gateway.log.splitlines()[-1]
