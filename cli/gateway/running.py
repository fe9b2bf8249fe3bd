"""What every gateway's command does alike: ports, ends, refusals, messages."""

import asyncio
import contextlib
import os
import signal
from collections.abc import Callable, Coroutine
from typing import Any

import typer

from traverse.cli.refusals import client_errors, refuse, system_refusal
from traverse.protocol.printable import printable


def run(
    command: str,
    port: Callable[[], str],
    work: Callable[[], Coroutine[Any, Any, None]],
) -> None:
    """Run a gateway to its end; refuse what it cannot have.

    Args:
        command: its name.
        port: what it listens on or writes to, for people.
        work: begins it.
    """
    with client_errors(command):
        try:
            asyncio.run(work())
        except OSError as error:
            if error.filename is not None:
                refuse(command, system_refusal(error))
            # asyncio puts a sentence of its own before the system's.
            is_of_system = error.errno is not None and error.errno > 0
            why = os.strerror(error.errno or 0) if is_of_system else error.strerror
            refuse(command, f"{port()}: {why}; name another port")


async def until_signal(work: Coroutine[Any, Any, None]) -> None:
    """Await it until SIGINT or SIGTERM."""
    task = asyncio.create_task(work)
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await task


def host_port(text: str, option: str, host: str | None) -> tuple[str, int]:
    """Read [HOST:]PORT; raises ValueError."""
    before, _, port = text.rpartition(":")
    host = before.strip("[]") or host
    if host is None or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise ValueError(f"{option} {text}: expected HOST:PORT, with a port to 65535")
    return host, int(port)


def report(text: str) -> None:
    """Say something to people."""
    typer.echo(printable(text), err=True)
