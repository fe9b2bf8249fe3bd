"""`traverse replay`: a recording through the same pipeline again."""

import asyncio
import logging
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.broker.address import BrokerAddress
from traverse.cli.broker_options import BrokerOptions
from traverse.cli.options import Force, Json
from traverse.cli.refusals import (
    FAILED,
    UNREACHABLE,
    check_target,
    refusals,
    refuse,
)
from traverse.plurals import counted

if TYPE_CHECKING:
    from collections.abc import Callable

    from traverse.daemon.replay.compare import ReplayResult
    from traverse.protocol.messages import Point
    from traverse.recording.run_reader import RunReader


def replay(
    file: Path,
    *,
    out: Path | None = None,
    block: Annotated[int | None, typer.Option(min=1, max=100_000)] = None,
    publish: bool = False,
    broker: BrokerOptions,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compute the points of a recording again, and compare.

    With the kernel of the recording (environment variable TRAVERSE_KERNEL) every number
    is the same to the last bit; with another one, coordinates are within 4 ulp of the
    arm's reach. Exit status 1: they are not, or points are missing.

    Args:
        file: A recording of the daemon (MCAP).
        out: Points are written here, one JSON a line.
        block: Samples of a block; without it, blocks are as they were.
        publish: Publish the points, in their own session.
    """
    from traverse.cli.replay.report import report_of, report_text  # noqa: PLC0415
    from traverse.recording.run_reader import RunReader  # noqa: PLC0415 - quick help
    from traverse.strict_toml.writing import replacing  # noqa: PLC0415

    address = broker.address()
    points: list[Point] = []
    check_target(out, force=force)
    with refusals(ValueError), ExitStack() as stack:
        reader = stack.enter_context(RunReader(file))
        lines = None if out is None else stack.enter_context(replacing(out))

        def take(point: "Point") -> None:
            if lines is not None:
                lines.write(point.model_dump_json().encode() + b"\n")
            if publish:
                points.append(point)

        about = dict(reader.about)
        result = asyncio.run(_replayed(reader, block, take))
    typer.echo(report_of(about, result) if as_json else report_text(about, result))
    if publish:
        _publish(points, address)
    if not result.holds:
        raise typer.Exit(FAILED)


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


def _publish(points: "list[Point]", broker: BrokerAddress) -> None:
    from traverse.cli.replay.publishing import published  # noqa: PLC0415 - quick help

    try:
        n = asyncio.run(published(points, broker))
    except OSError as error:
        refuse(f"broker {broker}: {error}", UNREACHABLE)
    typer.echo(f"{counted(n, 'point')} published", err=True)
