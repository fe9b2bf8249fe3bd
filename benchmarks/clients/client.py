"""`make bench-client`: the Python client beside a bare aiomqtt subscriber.

First 10 000 points over 20 connections that are cut, none lost or doubled. Then, in
turns on the same broker and from the same sender, how many points a second a bare
aiomqtt subscriber takes that only counts bytes, one that decodes them, and the client,
which decodes, orders and acknowledges them.
"""

import asyncio
import statistics
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import aiomqtt

from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.network import Network
from benchmarks.tools.rounds import load
from benchmarks.tools.sizes import sized
from tests.client.virtual_daemon import VirtualDaemon
from tests.protocol.message_examples import POINT
from traverse.client import Arm
from traverse.protocol.encoding import decode, encode
from traverse.protocol.messages import Point
from traverse.protocol.topics import point_topic

N_POINTS = sized(10_000, 200)
N_CUTS = sized(20, 2)
N_BURST = sized(5_000, 100)
ROUNDS = sized(5, 1)
Reader = Callable[[int, str, int, asyncio.Event], Awaitable[float]]


async def cut_often(port: int) -> dict[str, float]:
    """Points while connections are cut; raises where one is lost or doubled."""
    virtual = VirtualDaemon("bench-cut", "127.0.0.1", port)
    begun_s = time.perf_counter()
    async with (
        Network(port) as network,
        virtual.running(),
        Arm("bench-cut", f"127.0.0.1:{network.port}") as arm,
    ):
        taking = asyncio.create_task(_take_and_cut(virtual, network, arm))
        points = [await anext(arm.points()) for _ in range(N_POINTS)]
        await taking
        counters = arm.counters
    if points != virtual.points:
        raise AssertionError("points were lost, doubled, or out of order")
    return {
        "points": len(points),
        "cuts": network.cuts,
        "connections": counters.connections,
        "resend_requested": counters.resend_requested,
        "duplicates": counters.duplicates,
        "lost": counters.lost,
        "seconds": time.perf_counter() - begun_s,
    }


async def _take_and_cut(virtual: VirtualDaemon, network: Network, arm: Arm) -> None:
    for _ in range(N_CUTS):
        await virtual.take(N_POINTS // N_CUTS // 2)
        before = arm.counters.connections
        await network.cut()
        await virtual.take(N_POINTS // N_CUTS // 2)
        while arm.counters.connections == before:  # noqa: ASYNC110 - no event
            await asyncio.sleep(0.01)


async def bare(port: int, arm: str, n: int, ready: asyncio.Event) -> float:
    """Receive n points without decoding; return CPU seconds."""
    return await _subscribed(port, arm, n, ready, len)


async def decoding(port: int, arm: str, n: int, ready: asyncio.Event) -> float:
    """Receive n points with decoding; return CPU seconds."""
    return await _subscribed(port, arm, n, ready, lambda data: decode(Point, data))


async def _subscribed(
    port: int,
    arm: str,
    n: int,
    ready: asyncio.Event,
    use: Callable[[bytes], object],
) -> float:
    async with aiomqtt.Client("127.0.0.1", port) as client:
        await client.subscribe(point_topic(arm), qos=1)
        ready.set()
        n_received = 0
        async for message in client.messages:
            if not n_received:
                begun_s = time.process_time()
            use(bytes(message.payload))
            n_received += 1
            if n_received == n:
                break
        return time.process_time() - begun_s


async def client(port: int, arm: str, n: int, ready: asyncio.Event) -> float:
    async with Arm(arm, f"127.0.0.1:{port}", max_waiting=100_000) as following:
        ready.set()
        points = following.points()
        await anext(points)
        begun_s = time.process_time()
        for _ in range(n - 1):
            await anext(points)
        return time.process_time() - begun_s


async def rate(port: int, arm: str, reader: Reader) -> float:
    """Return points per CPU second of a reader, the sender being another program."""
    ready = asyncio.Event()
    async with VirtualDaemon(arm, "127.0.0.1", port).running() as virtual:
        reading = asyncio.ensure_future(reader(port, arm, N_BURST, ready))
        await ready.wait()
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "benchmarks.clients.client"),
            *(str(port), arm, virtual.session),
        )
        seconds = await reading
        await process.wait()
    return N_BURST / seconds


async def send(port: int, arm: str, session: str) -> None:
    async with aiomqtt.Client("127.0.0.1", port) as client:
        for seq in range(N_BURST):
            changed = {"session": session, "seq": seq, "id": f"{session}-{seq}"}
            point = POINT.model_copy(update=changed)
            payload = encode(point, "msgpack")
            await client.publish(point_topic(arm), payload, qos=1)


async def compare(port: int) -> None:
    print(load())
    cut = await cut_often(port)
    print(", ".join(f"{name} {value:g}" for name, value in cut.items()))
    readers: dict[str, Reader] = {
        "bare aiomqtt": bare,
        "bare aiomqtt, decoding": decoding,
        "client": client,
    }
    by_reader: dict[str, list[float]] = {name: [] for name in readers}
    for number in range(ROUNDS):
        for name, reader in readers.items():
            arm = f"arm-{number}-{len(name)}"
            by_reader[name].append(await rate(port, arm, reader))
    for name, rates in by_reader.items():
        print(
            f"{name:24} {statistics.median(rates):7.0f} points per CPU second "
            f"({min(rates):.0f} to {max(rates):.0f})"
        )
    print(load())


async def main(
    port: int | None = None, arm: str | None = None, session: str | None = None
) -> None:
    """Compare; with arguments only send points, as the comparison calls itself."""
    if port is not None and arm is not None and session is not None:
        await send(port, arm, session)
        return
    with tempfile.TemporaryDirectory() as name:
        number = rig.free_port()
        with rig.mosquitto(Path(name), number):
            await compare(number)


if __name__ == "__main__":
    run_main(main)
