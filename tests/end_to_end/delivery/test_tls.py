import asyncio
import contextlib
import signal
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import aiomqtt
import pytest

from tests.certificates import Authority
from tests.end_to_end.programs import PATIENCE_S, Program
from tests.end_to_end.workbench import REST, Workbench
from tests.mosquitto import HOST, Mosquitto, free_port
from traverse.client.cancel_tasks import cancel_tasks
from traverse.protocol.encoding import decode, encode
from traverse.protocol.messages import Args, Command, PointArgs, Reply, ScanArgs
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto", "openssl")

ACL = Path(__file__).parents[3] / "deploy" / "mosquitto" / "acl"
OPERATOR, DISPLAY, ARCHIVE = "bench-7-operator", "bench-7-display", "archive"
SECRET = "Xy-not-for-the-log-7"
OTHER_ARM = "bench-8"


class House:
    """A broker with a plain listener for people and one with TLS for daemons."""

    def __init__(self, folder: Path, make: Callable[..., Mosquitto]) -> None:
        self.authority = Authority(folder, "house")
        self.tls_port = free_port()
        pair = self.authority.sign("broker", "DNS:localhost")
        # Daemons show a certificate, people give a password.
        people = dict.fromkeys((OPERATOR, DISPLAY, ARCHIVE, OTHER_ARM), SECRET)
        self.broker = make(
            {**people, "bench-7": SECRET},
            acl=ACL,
            lines=(
                "use_username_as_clientid true",
                f"listener {self.tls_port} {HOST}",
                f"cafile {self.authority.certificate}",
                f"certfile {pair.certificate}",
                f"keyfile {pair.key}",
                "require_certificate true",
                "use_identity_as_username true",
                "tls_version tlsv1.2",
            ),
        )

    def bench(self, folder: Path, broker: str = "") -> Workbench:
        """An arm called bench-7 whose daemon has a certificate."""
        self.authority.sign("bench-7", file="arm")
        bench = Workbench(folder, "localhost", self.tls_port, "bench-7")
        bench.write_simulator(REST)
        files = (
            f'tls = true\nca_file = "{self.authority.certificate}"\n'
            'certificate_file = "arm.crt"\nkey_file = "arm.key"\n'
        )
        bench.write_daemon(broker=files + broker)
        return bench


class Person:
    """A user with an account: messages received, commands sent."""

    def __init__(self, client: aiomqtt.Client) -> None:
        self.client = client
        self.topics: list[str] = []
        self.replies: dict[str, Reply] = {}

    async def listen(self) -> None:
        async for message in self.client.messages:
            topic = str(message.topic)
            self.topics.append(topic)
            if "/reply/" in topic and isinstance(message.payload, bytes):
                reply = decode(Reply, message.payload)
                self.replies[reply.request] = reply

    async def send(self, args: Args, request: str, arm: str = "bench-7") -> None:
        payload = encode(Command.carrying(args, request), "json")
        topic = f"traverse/{arm}/cmd/{args.command}"
        await self.client.publish(topic, payload, qos=1)

    async def answer(self, request: str) -> Reply:
        await until(lambda: request in self.replies, f"an answer to {request}")
        return self.replies[request]

    async def ask(self, args: Args, request: str) -> Reply:
        """Send until answered: a daemon that is not connected yet misses it."""
        async with asyncio.timeout(PATIENCE_S):
            while request not in self.replies:
                await self.send(args, request)
                with contextlib.suppress(AssertionError):
                    await until(lambda: request in self.replies, "an answer", 0.3)
        return self.replies[request]


@contextlib.asynccontextmanager
async def person(port: int, name: str, **options: str) -> AsyncIterator[Person]:
    async with aiomqtt.Client(
        HOST, port, username=name, password=SECRET, timeout=PATIENCE_S, **options
    ) as client:
        arrived = Person(client)
        await client.subscribe("#", qos=1)
        await client.subscribe("traverse/#", qos=1)
        listening = asyncio.create_task(arrived.listen())
        try:
            yield arrived
        finally:
            await cancel_tasks([listening])


@contextlib.asynccontextmanager
async def measuring(bench: Workbench, *options: str) -> AsyncIterator[Program]:
    with bench.simulator() as simulator:
        await simulator.says("ready base")
        with bench.daemon(*options) as daemon:
            yield daemon
            assert await daemon.stop() == 0
        assert await simulator.stop() == 0


@pytest.mark.slow
async def test_clients_read_and_command_their_own_arm_alone(
    make_mosquitto: Callable[..., Mosquitto], tmp_path: Path
) -> None:
    house = House(tmp_path, make_mosquitto)
    bench = house.bench(tmp_path)
    port = house.broker.port
    async with (
        person(port, OPERATOR) as operator,
        person(port, DISPLAY) as display,
        person(port, ARCHIVE) as archive,
        person(port, OTHER_ARM) as other,
    ):
        async with measuring(bench):
            await until(
                lambda: "traverse/bench-7/health" in operator.topics, "the arm's health"
            )
            await display.send(PointArgs(), "display")
            await archive.send(PointArgs(), "archive")
            await other.send(PointArgs(), "other")
            await other.client.publish("traverse/bench-7/point", b"forged", qos=1)
            await operator.send(PointArgs(), "elsewhere", arm=OTHER_ARM)
            await operator.client.publish("traverse/bench-7/status", b"", qos=1)
            await operator.send(PointArgs(), "mine")
            answer = await operator.answer("mine")
            assert answer.ok
            assert (answer.result or {})["seq"] == 0  # none of the others took one
            await until(lambda: "traverse/bench-7/point" in archive.topics, "a point")
            # Another client's identifier disconnects no one.
            async with person(port, OTHER_ARM, identifier="traverse-bench-7"):
                await operator.send(PointArgs(), "again")
                assert (await operator.answer("again")).ok
        kinds = {"status", "point", "event", "health", "live", "clock"}
        of_arm = {f"traverse/bench-7/{kind}" for kind in kinds}
        assert set(operator.topics) <= of_arm | {"traverse/bench-7/reply/point"}
        assert set(display.topics) <= of_arm
        assert "traverse/bench-7/status" in display.topics
        assert set(archive.topics) == {
            "traverse/bench-7/point",
            "traverse/bench-7/status",
        }
        assert archive.topics.count("traverse/bench-7/point") == 2
        assert other.topics == []


async def test_no_secret_shows_and_a_renewed_certificate_is_taken_on_a_reload(
    make_mosquitto: Callable[..., Mosquitto], tmp_path: Path
) -> None:
    house = House(tmp_path, make_mosquitto)
    password = tmp_path / "password"
    password.write_text(SECRET)
    password.chmod(0o640)
    bench = house.bench(tmp_path, 'username = "bench-7"\npassword_file = "password"\n')
    async with (
        person(house.broker.port, OPERATOR) as operator,
        measuring(bench, "--log-level", "debug") as daemon,
    ):
        await daemon.says("chmod 600 it")
        assert (await operator.ask(ScanArgs(action="stop"), "first")).ok
        house.authority.sign("bench-7", file="arm")
        daemon.process.send_signal(signal.SIGHUP)
        await daemon.says("connecting anew")
        assert (await operator.ask(ScanArgs(action="stop"), "second")).ok
        proc = Path(f"/proc/{daemon.process.pid}")
        shown = (proc / "cmdline").read_bytes() + (proc / "environ").read_bytes()
        assert SECRET.encode() not in shown
    output = daemon.log + daemon.output
    assert SECRET not in output
    assert "PRIVATE KEY" not in output
