"""`python -m benchmarks.peers.mqtt_clients [FILE]`: our MQTT client beside peers.

Paho is the quickest known that waits for acknowledgements, gmqtt the quickest receiver.

Through one mosquitto, by turns: CPU time (all threads) of 1,000 messages of 500 bytes
published at quality of service 1, each waited for by its sender, 16 of them at a time;
and of 10,000 messages of 500 bytes received as fast as they come, from a program of its
own. Each by the public interface, as its documentation has it; and the lines of code
that each consists of.
"""

import asyncio
import importlib
import inspect
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.raw_mqtt import PAYLOAD_BYTES
from benchmarks.tools.rounds import load, write_json
from benchmarks.tools.sizes import sized
from traverse.broker.client import MqttClient

N_SENT, N_RECEIVED = sized((1000, 10_000), (30, 100))
ROUNDS = sized(5, 1)
AT_ONCE = 16
IN, OUT = "peers/in", "peers/out"
PAYLOAD = bytes(PAYLOAD_BYTES)
# Of the library itself, without its tests and examples.
PACKAGES = {
    "Traverse": ("traverse.broker.client", "traverse.broker.packets"),
    "paho": ("paho.mqtt",),
    "gmqtt": ("gmqtt",),
}


class Client:
    """Measured figures of a client: sending, and receiving until all have arrived."""

    def __init__(self, publish: Callable[[], Awaitable[object]]) -> None:
        self.publish = publish
        self.n_received = 0
        self.is_complete = asyncio.Event()

    def received(self) -> None:
        self.n_received += 1
        if self.n_received == N_RECEIVED:
            self.is_complete.set()


@asynccontextmanager
async def ours(port: int) -> AsyncIterator[Client]:
    async with MqttClient("127.0.0.1", port) as link:
        client = Client(lambda: link.publish(OUT, PAYLOAD, 1))
        await link.subscribe((IN, 1))

        async def receive() -> None:
            async for _ in link.messages:
                client.received()

        task = asyncio.create_task(receive())
        yield client
        task.cancel()


@asynccontextmanager
async def paho(port: int) -> AsyncIterator[Client]:
    library = importlib.import_module("paho.mqtt.client")
    loop = asyncio.get_running_loop()
    link = library.Client(library.CallbackAPIVersion.VERSION2)
    link.connect("127.0.0.1", port)
    link.loop_start()
    room, n_left = threading.Semaphore(AT_ONCE), [0]

    def published(*_: object) -> None:
        n_left[0] -= 1
        room.release()

    async def publish() -> None:
        """Publish from its own thread, as paho is used; all acknowledged at the end."""

    link.on_publish = published
    client = Client(publish)
    link.on_message = lambda *_: loop.call_soon_threadsafe(client.received)

    def send_all() -> None:
        for _ in range(N_SENT):
            room.acquire()
            n_left[0] += 1
            link.publish(OUT, PAYLOAD, 1)
        while n_left[0]:
            time.sleep(0.001)

    client.send_all = send_all  # type: ignore[attr-defined]
    link.subscribe(IN, 1)
    await asyncio.sleep(0.2)
    yield client
    link.disconnect()
    link.loop_stop()


@asynccontextmanager
async def gmqtt(port: int) -> AsyncIterator[Client]:
    library = importlib.import_module("gmqtt")
    link = library.Client("peers-gmqtt")
    client: Client

    async def received(*_: object) -> int:
        client.received()
        return 0

    link.on_message = received
    await link.connect("127.0.0.1", port)
    link.subscribe(IN, 1)

    async def publish() -> None:
        """Has no public way to wait for the acknowledgement of one message."""
        link.publish(OUT, PAYLOAD, qos=1)
        await asyncio.sleep(0.02)  # or its numbers run out

    client = Client(publish)
    yield client
    await link.disconnect()


CLIENTS = {"Traverse": ours, "paho": paho, "gmqtt": gmqtt}


async def send_all(client: Client) -> None:
    if (by_thread := getattr(client, "send_all", None)) is not None:
        await asyncio.to_thread(by_thread)
        return
    left = iter(range(N_SENT))

    async def some() -> None:
        for _ in left:
            await client.publish()

    await asyncio.gather(*(some() for _ in range(AT_ONCE)))


async def measured(name: str, port: int) -> tuple[float, float]:
    """CPU time of sending and of receiving [ms]."""
    async with CLIENTS[name](port) as client:
        begun_s = time.process_time()
        await send_all(client)
        await asyncio.sleep(0.5 if name == "gmqtt" else 0.0)  # its acknowledgements
        sent_ms = (time.process_time() - begun_s) * 1e3
        words = (str(port), IN, "1e6", str(N_RECEIVED))
        run = (sys.executable, "-m", "benchmarks.tools.raw_mqtt", *words)
        begun_s = time.process_time()
        sender = subprocess.Popen(run, stdout=subprocess.DEVNULL)  # noqa: ASYNC220
        await client.is_complete.wait()
        received_ms = (time.process_time() - begun_s) * 1e3
        while sender.poll() is None:  # noqa: ASYNC110 - nothing tells it
            await asyncio.sleep(0.05)
    return sent_ms, received_ms


def n_lines(name: str) -> int:
    """Lines of a client's code that are neither empty nor comments."""
    files: set[Path] = set()
    for package in PACKAGES[name]:
        module = importlib.import_module(package)
        path = Path(inspect.getfile(module))
        files.update(path.parent.rglob("*.py") if path.stem == "__init__" else [path])
    return sum(
        bool(line.strip()) and not line.strip().startswith("#")
        for path in files
        for line in path.read_text("utf-8").splitlines()
    )


def main(path: Path | None = None) -> None:
    print(load())
    names = [name for name in CLIENTS if _is_there(name)]
    values_of: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
    with tempfile.TemporaryDirectory() as folder:
        port = rig.free_port()
        with rig.mosquitto(Path(folder), port):
            for _ in range(ROUNDS):
                for name in names:
                    values_of[name].append(asyncio.run(measured(name, port)))
    for name, values in values_of.items():
        sent, received = (sorted(column) for column in zip(*values, strict=True))
        middle = len(values) // 2
        print(
            f"{name:9} {N_SENT} sent {sent[middle]:4.0f} ms ({sent[0]:.0f} to "
            f"{sent[-1]:.0f}); {N_RECEIVED} received {received[middle]:4.0f} ms "
            f"({received[0]:.0f} to {received[-1]:.0f}); {n_lines(name)} lines"
        )
    print(load())
    write_json(path, values_of)


def _is_there(name: str) -> bool:
    try:
        importlib.import_module(PACKAGES[name][0])
    except ImportError:
        print(f"{name} is not installed")
        return False
    return True


if __name__ == "__main__":
    run_main(main)
