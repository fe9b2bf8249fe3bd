"""Common parts of gateway commands: begin, send, end, refuse, report."""

import asyncio
import contextlib
import os
import signal
from collections.abc import Coroutine
from typing import TYPE_CHECKING, Any, Literal

import typer

from traverse.cli.common.refusals import client_errors, refuse, system_refusal
from traverse.plurals import counted
from traverse.protocol.printable import printable

if TYPE_CHECKING:
    from traverse.client.arm import Arm
    from traverse.client.gateways.lines import LineGateway
    from traverse.client.gateways.live import LiveServer
    from traverse.client.gateways.opcua import OpcUaServer

Kind = Literal["points", "scans"]


def run(port: str, work: Coroutine[Any, Any, None]) -> None:
    """Run a gateway to its end, or refuse its options.

    Args:
        port: its address or device, for people.
        work: runs it.
    """
    with client_errors():
        try:
            asyncio.run(work)
        except OSError as error:
            if error.filename is not None:
                refuse(system_refusal(error))
            # asyncio puts a sentence of its own before the system's.
            is_of_system = error.errno is not None and error.errno > 0
            why = os.strerror(error.errno or 0) if is_of_system else error.strerror
            refuse(f"{port}: {why}; name another port")


async def until_signal(work: Coroutine[Any, Any, None]) -> None:
    task = asyncio.create_task(work)
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await task


async def send(arm: "Arm", kind: Kind, sender: "LineGateway") -> None:
    """Send until SIGINT or SIGTERM; report the beginning, and the sums at the end."""
    outlet = sender.outlet
    async with outlet, arm:
        report(f"{kind} of {arm.name} to {outlet.name}: {outlet.promise}")
        work = sender.send_scans if kind == "scans" else sender.send_points
        # What is being sent when this ends is not done: the next one sends it.
        await until_signal(work(arm))
    counts = sender.counts
    report(
        f"{counted(counts.sent, 'line')} sent, "
        f"{counted(counts.held_back, 'point')} held back, "
        f"{counts.undone} taken back and {counts.doubted} in doubt after they were "
        f"sent, {counts.lost} lost"
    )


async def serve(arm: "Arm", server: "LiveServer | OpcUaServer", use: str) -> None:
    """Serve until SIGINT or SIGTERM; report the address and its use, and the sum."""
    async with server, arm:
        report(f"{arm.name} at {server.address}: {use}")
        await until_signal(server.serve())
    report(f"{counted(server.points, 'point')} shown")


def host_port(text: str, option: str, host: str | None) -> tuple[str, int]:
    """Read [HOST:]PORT; raises ValueError."""
    before, _, port = text.rpartition(":")
    host = before.strip("[]") or host
    if host is None or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise ValueError(f"{option} {text}: expected HOST:PORT, with a port to 65535")
    return host, int(port)


def report(text: str) -> None:
    typer.echo(printable(text), err=True)
