"""The live display of `traverse watch`: read-out, points, health, in a terminal."""

import time

import numpy as np
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from traverse.client.display.arm_state import ArmSight
from traverse.client.display.condition import verdict
from traverse.protocol.messages import Event, Point

COLOURS = {"good": "bold green", "warning": "bold yellow", "bad": "bold white on red"}
MOST_POINTS = 12
MOST_EVENTS = 5
DIAGONAL = (0, 3, 5)  # of xx, xy, xz, yy, yz, zz


def picture(name: str, sight: ArmSight) -> RenderableType:
    """All that is known of an arm, for a terminal."""
    said = verdict(sight)
    more = f" (and {said.others} more)" if said.others else ""
    head = Text(f" {said.sentence}{more} ", style=COLOURS[said.level])
    lines: list[RenderableType] = [head]
    if said.remedy:
        lines.append(Text(said.remedy))
    lines += [Text(), _read_out(sight), Text(), _points(sight), Text(), _health(sight)]
    told = [e for e in sight.events if e.severity != "info" or e.active is not None]
    lines += [Text(_event(e), style="dim") for e in told[-MOST_EVENTS:]]
    return Panel(Group(*lines), title=name, subtitle="Ctrl-C ends", padding=(0, 1))


def _read_out(sight: ArmSight) -> RenderableType:
    live = sight.live
    if live is None:
        return Text("no pose yet", style="dim")
    stale = sight.is_stale
    table = Table(box=None, pad_edge=False, show_header=False)
    for axis, name in enumerate("XYZ"):
        part = "" if live.part_xyz_mm is None else f"part {live.part_xyz_mm[axis]:.4f}"
        value = Text(f"{live.xyz_mm[axis]:12.4f} mm", style="dim" if stale else "bold")
        table.add_row(name, value, part)
    speed = "" if live.speed_mm_s is None else f"{live.speed_mm_s:.0f} mm/s  "
    flags = ", ".join(live.quality.flags).replace("_", " ")
    old = f"  STALE: {sight.age_s:.0f} s old" if stale else ""
    return Group(table, Text(f"{speed}{flags}{old}"))


def _points(sight: ArmSight) -> RenderableType:
    table = Table(box=None, pad_edge=False)
    for title in ("no.", "x mm", "y mm", "z mm", "U, k=2, mm"):
        table.add_column(title, justify="right")
    table.add_column("label")
    table.add_column("remarks")
    points = list(sight.points.values())
    for point in points[: -MOST_POINTS - 1 : -1]:
        style = "" if point.quality.ok else "yellow"
        table.add_row(*_row(point), style=style)
    lost = f", {sight.lost_points} lost" if sight.lost_points else ""
    return Group(Text(f"{len(points)} points{lost}", style="bold"), table)


def _row(point: Point) -> list[str]:
    around = ""
    if point.covariance_mm2 is not None:
        trace = sum(point.covariance_mm2[i] for i in DIAGONAL)
        around = f"{2.0 * float(np.sqrt(max(trace, 0.0))):.4f}"
    label = " ".join(filter(None, (point.label.artefact, point.label.feature)))
    flags = ", ".join(point.quality.flags).replace("_", " ")
    return [
        str(point.seq),
        *(f"{value:.4f}" for value in point.xyz_mm),
        around,
        label,
        flags,
    ]


def _health(sight: ArmSight) -> RenderableType:
    health = sight.health
    if health is None:
        return Text("no figures yet", style="dim")
    devices = ", ".join(
        f"{d.id} {d.state} {d.rate_hz:.0f} samples/s" for d in health.devices
    )
    outbox = health.outbox
    return Text(
        f"{devices}; broker {health.broker.state}; {outbox.points} points kept, "
        f"{outbox.unsent} to be sent; {health.cpu_share:.0%} of a core, "
        f"{health.rss_bytes / 1e6:.0f} MB",
        style="dim",
    )


def _event(event: Event) -> str:
    at = time.strftime("%H:%M:%S", time.localtime(event.last_ns * 1e-9))
    ended = " (over)" if event.active is False else ""
    return f"{at} {event.source}: {event.text}{ended}"
