"""`make soak`: a stream through outages of broker and board."""

import asyncio
import contextlib
import tempfile
import time
from pathlib import Path

import aiomqtt

from benchmarks import rig
from benchmarks.stream import ARM, Followed, order_scan
from clients.subscription import connection, received, subscribe
from protocol.messages import Event, Scan

OUTAGE_S = 10.0


async def _follow(
    port: int, followed: Followed, rate_hz: float, until_s: float
) -> None:
    """Follow the scan, coming back whenever the broker does."""
    ordered = False
    while time.monotonic() < until_s:
        with contextlib.suppress(aiomqtt.MqttError, OSError, TimeoutError):
            async with (
                asyncio.timeout(until_s - time.monotonic()),
                connection("127.0.0.1", port) as client,
            ):
                await subscribe(client, ARM, ("scan", "event"))
                if not ordered:
                    await order_scan(client, "start", rate_hz)
                    ordered = True
                async for item in received(client):
                    if isinstance(item.message, Scan):
                        followed.add(item.message)
                    elif isinstance(item.message, Event):
                        followed.events.append(
                            f"{item.message.code} {item.message.active}"
                        )
        await asyncio.sleep(0.05)


def outages(folder: Path, rate_hz: float = 1000.0) -> list[str]:
    """Kill broker and board for ten seconds each during a scan."""
    port = rig.free_port()
    followed = Followed()
    with contextlib.ExitStack() as stack:
        broker = stack.enter_context(rig.mosquitto(folder, port))
        board = stack.enter_context(rig.simulator(folder))
        process = stack.enter_context(rig.daemon(folder, port))

        async def scenario() -> None:
            until_s = time.monotonic() + 2 * OUTAGE_S + 20.0
            following = asyncio.create_task(_follow(port, followed, rate_hz, until_s))
            await asyncio.sleep(5.0)
            rig.stop(broker, 9)
            await asyncio.sleep(OUTAGE_S)
            stack.enter_context(rig.mosquitto(folder, port))
            await asyncio.sleep(5.0)
            rig.stop(board, 9)
            await asyncio.sleep(OUTAGE_S)
            stack.enter_context(rig.simulator(folder))
            await following

        asyncio.run(scenario())
        alive = process.poll() is None
    instants = followed.expected_seq
    return [
        f"daemon alive: {alive}; {followed.samples} of {instants} instants received",
        f"gaps seen by the subscriber (from, to): {followed.gaps}",
        f"reported by the daemon: {followed.lost} lost, {followed.dropped} dropped",
        f"events: {', '.join(followed.events)}",
    ]


def main() -> None:
    """Print what came of it."""
    with tempfile.TemporaryDirectory() as folder:
        print("\n".join(outages(Path(folder))))


if __name__ == "__main__":
    main()
