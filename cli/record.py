"""`traverse record`: have the daemon record, and wait."""

import asyncio
import json
from collections.abc import Mapping
from typing import Annotated, Any

import typer

from traverse.broker.address import BrokerAddress
from traverse.cli.common.broker_options import BrokerOptions
from traverse.cli.common.options import Json
from traverse.cli.common.refusals import client_errors
from traverse.plurals import counted


def record(
    name: str,
    *,
    arm: str,
    broker: BrokerOptions,
    seconds: Annotated[float | None, typer.Option(min=0.1)] = None,
    note: str = "",
    as_json: Json = False,
) -> None:
    """Record what an arm does, on the daemon's disk.

    The MCAP file begins some seconds before the command, where the flight recorder is
    on.

    Args:
        name: New name for the recording.
        arm: Name of the arm.
        seconds: Duration; else until Ctrl-C.
        note: Text stored in the recording.
    """
    address = broker.address()
    with client_errors():
        recorded = asyncio.run(
            _record(name, arm, address, seconds, note, quiet=as_json)
        )
    typer.echo(json.dumps(recorded) if as_json else _summary(recorded))


async def _record(
    name: str,
    arm: str,
    broker: BrokerAddress,
    seconds: float | None,
    note: str,
    *,
    quiet: bool,
) -> dict[str, Any]:
    import signal

    from traverse.client.arm import Arm
    from traverse.protocol.messages import RecordArgs

    async with Arm(arm, broker) as client:
        start = RecordArgs(action="start", name=name, note=note or None)
        started = await client.execute(start)
        typer.echo(f"recording {started['file']}", err=quiet)
        ended = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, ended.set)
        try:
            async with asyncio.timeout(seconds):
                await ended.wait()
        except TimeoutError:
            pass  # so long it was to be
        return dict(await client.execute(RecordArgs(action="stop")))


def _summary(recorded: Mapping[str, Any]) -> str:
    gaps = recorded["gaps"]
    lacking = f", {counted(gaps, 'gap')}: the disk did not keep up" if gaps else ""
    return (
        f"{recorded['file']}: {recorded['seconds']:.1f} s, "
        f"{counted(recorded['bytes'], 'byte')}, "
        f"{counted(recorded['messages'], 'message')}{lacking}"
    )
