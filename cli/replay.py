"""`traverse replay`: a recording through the same pipeline again."""

import asyncio
import json
import logging
import uuid
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.broker.address import BrokerAddress
from traverse.cli.common.broker_options import BrokerOptions
from traverse.cli.common.options import Force, Json
from traverse.cli.common.refusals import (
    FAILED,
    UNREACHABLE,
    check_target,
    refusals,
    refuse,
)
from traverse.plurals import counted

if TYPE_CHECKING:
    from traverse.daemon.replay.compare import ReplayResult, Tally
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
    from traverse.recording.run_reader import RunReader
    from traverse.strict_toml.writing import replacing

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
    reader: "RunReader", block: int | None, take: Callable[["Point"], None]
) -> "ReplayResult":
    from traverse.daemon.replay.replay import Replay

    log = logging.getLogger("traverse.daemon")
    level = log.level
    log.setLevel(logging.CRITICAL)  # recorded events are not logged as new ones
    try:
        return Replay(reader, block, take_point=take).run()
    finally:
        log.setLevel(level)


def _publish(points: "list[Point]", broker: BrokerAddress) -> None:
    try:
        n = asyncio.run(_published(points, broker))
    except OSError as error:
        refuse(f"broker {broker}: {error}", UNREACHABLE)
    typer.echo(f"{counted(n, 'point')} published", err=True)


async def _published(points: Sequence["Point"], broker: BrokerAddress) -> int:
    """Publish points; return how many.

    Sessions and ids are new, so that consumers neither mistake these points for the
    captured ones nor drop them as duplicates.

    Raises:
        OSError: the broker cannot be reached.
    """
    from traverse.broker.errors import MqttError
    from traverse.client.mqtt.connection import ConfiguredClient
    from traverse.protocol.encoding import encode
    from traverse.protocol.topics import point_topic

    sessions: dict[str, str] = {}
    try:
        async with ConfiguredClient(broker) as client:
            for point in points:
                session = sessions.setdefault(
                    point.session, f"replay-{uuid.uuid4().hex}"
                )
                retracts = point.retracts
                renamed = point.model_copy(
                    update={
                        "session": session,
                        "id": _own_id(point.id, sessions),
                        "retracts": retracts and _own_id(retracts, sessions),
                    }
                )
                await client.publish(
                    point_topic(renamed.arm), encode(renamed, "msgpack"), 1
                )
    except MqttError as error:
        raise OSError(str(error)) from error
    return len(points)


def _own_id(point_id: str, sessions: dict[str, str]) -> str:
    session, _, number = point_id.rpartition("-")
    return f"{sessions.get(session, session)}-{number}"


def report_of(about: Mapping[str, str], result: "ReplayResult") -> str:
    points, scans = result.points, result.scans
    table = {
        "schema": "traverse/replay/1",
        "about": dict(about),
        "holds": result.holds,
        "kernel": {"then": result.kernel_then, "now": result.kernel_now},
        "points": _table(points.sure),
        "early_points": _table(points.early),
        "scan_points": _table(scans.tally),
        "missing": {
            "points": points.missing,
            "scan_points": scans.missing,
        },
        "new_points": points.new,
        "not_kept": points.not_kept,
        "excused": points.excused,
        "left_out_scan_points": scans.left_out,
        "samples": result.samples,
        "gaps": result.gaps,
        "tolerance_mm": points.tolerance_mm,
        "tear": result.tear,
    }
    return json.dumps(table, indent=2)


def report_text(about: Mapping[str, str], result: "ReplayResult") -> str:
    points, scans = result.points, result.scans
    is_same = result.kernel_then == result.kernel_now
    kernel = result.kernel_now
    if not is_same:
        kernel = (
            f"{kernel} (recorded with {result.kernel_then}; "
            f"TRAVERSE_KERNEL={result.kernel_then} takes that one)"
        )
    lines = [
        f"arm {about.get('arm')}, {counted(result.samples, 'sample')}, kernel {kernel}",
        *_lines("points", points.sure, result, is_same=is_same),
        *_lines("points of scans", scans.tally, result, is_same=is_same),
    ]
    early, faults = points.early, []
    if early.n:
        lines.append(
            f"first seconds of a recording that began in the middle, not judged: "
            f"{early.same} of {counted(early.n, 'point')} the same"
        )
    if points.excused:
        lines.append(
            f"{counted(points.excused, 'interpolated point')}: another covariance, as "
            "blocks are cut otherwise"
        )
    if scans.left_out:
        left_out = counted(scans.left_out, "point")
        lines.append(f"{left_out} of scans begun before: not compared")
    if points.missing or scans.missing:
        faults.append(
            f"missing: {counted(points.missing, 'point')}, "
            f"{counted(scans.missing, 'point')} of scans"
        )
    if points.new:
        faults.append(
            f"{counted(points.new, 'point')} more than published ({points.not_kept} "
            "could not be kept then)"
        )
    if result.gaps:
        faults.append(f"{counted(result.gaps, 'gap')}: the disk did not keep up then")
    if result.tear is not None:
        faults.append(f"the file is {result.tear}")
    verdict = "the same" if is_same else "within the tolerance"
    lines += [*faults, verdict if result.holds else f"NOT {verdict}"]
    return "\n".join(lines)


def _lines(
    compared: str, tally: "Tally", result: "ReplayResult", *, is_same: bool
) -> list[str]:
    if not tally.n:
        return [f"no {compared} to compare"]
    lines = [
        f"{tally.same} of {tally.n} {compared} the same to the last bit, greatest "
        f"difference {tally.largest_mm:.3g} mm"
    ]
    if not is_same:
        lines.append(
            f"{tally.within} of {tally.n} within 4 ulp of the reach, "
            f"{result.points.tolerance_mm:.3g} mm"
        )
    if tally.differing and is_same:
        fields = ", ".join(f"{name} {n}" for name, n in tally.differing.most_common())
        lines.append(f"differing: {fields}")
    return lines


def _table(tally: "Tally") -> dict[str, object]:
    return {
        "compared": tally.n,
        "same": tally.same,
        "within": tally.within,
        "largest_mm": tally.largest_mm,
        "differing": dict(tally.differing),
    }
