"""`traverse replay`: a recording through the same pipeline again."""

import asyncio
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.broker_options import BrokerOptions, with_broker

if TYPE_CHECKING:
    from collections.abc import Callable

    from traverse.client.mqtt.address import BrokerAddress
    from traverse.daemon.replay.result import ReplayResult
    from traverse.protocol.messages import Point
    from traverse.recording.run_reader import RunReader

DIFFERENT, REFUSED, UNREACHABLE = 1, 2, 3


@with_broker
def replay(
    file: Annotated[Path, typer.Argument(help="A recording of the daemon (MCAP).")],
    *,
    out: Annotated[
        Path | None, typer.Option(help="Points are written here, one JSON a line.")
    ] = None,
    block: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=100_000,
            help="Samples of a block; without it, blocks are as they were.",
        ),
    ] = None,
    publish: Annotated[
        bool,
        typer.Option("--publish", help="Publish the points, in their own session."),
    ] = False,
    broker: BrokerOptions,
    as_json: Annotated[bool, typer.Option("--json", help="Report as JSON.")] = False,
) -> None:
    """Compute the points of a recording again, and compare.

    With the kernel of the recording (environment variable TRAVERSE_KERNEL) every number
    is the same to the last bit; with another one, coordinates are within 4 ulp of the
    arm's reach. Exit status 1: they are not, or points are missing; 2: the file was
    refused; 3: the broker could not be reached.
    """
    from traverse.cli.replay.report import report_of, report_text  # noqa: PLC0415
    from traverse.recording.run_reader import RunReader  # noqa: PLC0415 - quick help

    address = broker.address("replay")
    points: list[Point] = []
    try:
        lines = None if out is None else out.open("w", encoding="utf-8")
        try:

            def take(point: "Point") -> None:
                if lines is not None:
                    lines.write(point.model_dump_json() + "\n")
                if publish:
                    points.append(point)

            with RunReader(file) as reader:
                about = dict(reader.about)
                result = asyncio.run(_replayed(reader, block, take))
        finally:
            if lines is not None:
                lines.close()
    except OSError as error:
        text = f"{error.filename or file}: {error.strerror or error}; check the path"
        typer.echo(f"traverse replay: {text}", err=True)
        raise typer.Exit(REFUSED) from error
    except ValueError as error:
        typer.echo(f"traverse replay: {error}", err=True)
        raise typer.Exit(REFUSED) from error
    typer.echo(report_of(about, result) if as_json else report_text(about, result))
    if publish:
        _publish(points, address)
    if not result.holds:
        raise typer.Exit(DIFFERENT)


async def _replayed(
    reader: "RunReader", block: int | None, take: "Callable[[Point], None]"
) -> "ReplayResult":
    from traverse.daemon.replay.replay import Replay  # noqa: PLC0415 - keeps --help quick

    log = logging.getLogger("traverse.daemon")
    level = log.level
    log.setLevel(logging.CRITICAL)  # recorded events are not logged as new ones
    try:
        return Replay(reader, block, take_point=take).run()
    finally:
        log.setLevel(level)


def _publish(points: "list[Point]", broker: "BrokerAddress") -> None:
    from traverse.cli.replay.publishing import published  # noqa: PLC0415 - quick help

    try:
        n = asyncio.run(published(points, broker))
    except OSError as error:
        typer.echo(f"traverse replay: broker {broker}: {error}", err=True)
        raise typer.Exit(UNREACHABLE) from error
    typer.echo(f"{n} points published", err=True)
