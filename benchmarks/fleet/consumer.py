"""One consumer of a group: `python -m benchmarks.fleet.consumer PORT NAME FILE`.

Reads its share of all arms' points and scans, decodes all, and at SIGTERM writes a
summary: arm, kind, series (session or scan), first number, count.
"""

import asyncio
import json
import signal
import socket
import sys
from pathlib import Path

import aiomqtt

from benchmarks.tools.command_line import run_main
from traverse.protocol.encoding import decode
from traverse.protocol.messages import Point, Scan

GROUP = "$share/store/traverse/+"
MOST_WAITING = 100_000


async def consume(port: int, name: str) -> dict[str, object]:
    """Read until SIGTERM; return received messages and counts."""
    had: list[tuple[str, str, str, int, int]] = []
    losses: dict[str, tuple[int, int]] = {}
    n_bytes = 0
    ended = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, ended.set)
    async with aiomqtt.Client(
        "127.0.0.1",
        port,
        identifier=name,
        max_queued_incoming_messages=MOST_WAITING,
        socket_options=[(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)],
    ) as client:
        for kind, qos in (("point", 1), ("scan", 0)):
            await client.subscribe(f"{GROUP}/{kind}", qos=qos)
        sys.stdout.write("ready\n")
        sys.stdout.flush()

        async def read() -> None:
            nonlocal n_bytes
            async for message in client.messages:
                payload = bytes(message.payload)
                n_bytes += len(payload)
                if str(message.topic).endswith("/point"):
                    point = decode(Point, payload)
                    had.append((point.arm, "point", point.session, point.seq, 1))
                else:
                    scan = decode(Scan, payload)
                    n = len(scan.dtime_ns)
                    had.append((scan.arm, "scan", scan.scan, scan.seq, n))
                    losses[scan.arm] = (scan.lost, scan.dropped)

        reading = asyncio.create_task(read())
        await ended.wait()
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)
    return {"had": had, "losses": losses, "bytes": n_bytes}


def main(port: int, name: str, file: Path) -> None:
    consumed = asyncio.run(consume(port, name))
    file.write_text(json.dumps(consumed), "utf-8")


if __name__ == "__main__":
    run_main(main)
