"""The live display of `traverse watch`: read-out, points, health, in a terminal."""

import time

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from traverse.client.display.arm_state import ArmSight
from traverse.client.display.condition import verdict
from traverse.client.display.figures import (
    SYSTEMS,
    System,
    Unit,
    flag_words,
    label_words,
    place_mm,
    place_uncertainty,
)
from traverse.plurals import counted
from traverse.protocol.messages import Event, Point
from traverse.protocol.printable import printable

COLOURS = {
    "good": "bold white on green4",
    "busy": "bold white on blue",
    "warning": "bold black on yellow",
    "bad": "bold white on red",
}
MOST_POINTS = 12
MOST_EVENTS = 5
MM = Unit("mm", 1.0, 4)


def picture(name: str, sight: ArmSight) -> RenderableType:
    current_verdict = verdict(sight)
    head = f" {current_verdict.word.upper()}  {printable(current_verdict.text)} "
    lines: list[RenderableType] = [Text(head, style=COLOURS[current_verdict.level])]
    if current_verdict.remedy:
        lines.append(Text(printable(current_verdict.remedy)))
    system: System = "part" if sight.is_aligned else "arm"
    lines += [Text(), _read_out(sight, system), Text(), _points(sight, system)]
    lines += [Text(), _health(sight)]
    shown = [e for e in sight.events if e.severity != "info" or e.active is not None]
    lines += [Text(_event(e), style="dim") for e in shown[-MOST_EVENTS:]]
    return Panel(Group(*lines), title=name, subtitle="Ctrl-C ends", padding=(0, 1))


def _read_out(sight: ArmSight, system: System) -> RenderableType:
    live = sight.live
    if live is None:
        return Text("no pose yet", style="dim")
    stale = sight.is_stale
    table = Table(box=None, pad_edge=False, show_header=False)
    for name, value_mm in zip("XYZ", place_mm(live, system) or (), strict=True):
        value = Text(f"{MM.text(value_mm):>12} mm", style="dim" if stale else "bold")
        table.add_row(name, value)
    speed = "" if live.speed_mm_s is None else f"{live.speed_mm_s:.0f} mm/s"
    old = f"STALE: {sight.age_s:.0f} s old" if stale else ""
    details = (f"ball centre, {SYSTEMS[system]}", speed, flag_words(live), old)
    return Group(table, Text("  ".join(filter(None, details))))


def _points(sight: ArmSight, system: System) -> RenderableType:
    table = Table(box=None, pad_edge=False)
    for title in ("no.", "x mm", "y mm", "z mm", "U, k=2, mm"):
        table.add_column(title, justify="right")
    table.add_column("label")
    table.add_column("remarks")
    points = list(sight.points.values())
    for point in points[: -MOST_POINTS - 1 : -1]:
        style = "" if point.quality.ok else "yellow"
        table.add_row(*_row(point, system), style=style)
    lost = f", {sight.lost_points} lost" if sight.lost_points else ""
    old = "" if sight.is_online else ", out of date"
    title = f"{counted(len(points), 'point')}{lost}{old}, {SYSTEMS[system]}"
    return Group(Text(title, style="bold"), table)


def _row(point: Point, system: System) -> list[str]:
    place = place_mm(point, system)
    return [
        str(point.seq),
        *(("-",) * 3 if place is None else map(MM.text, place)),
        place_uncertainty(point, MM),
        label_words(point),
        flag_words(point),
    ]


def _health(sight: ArmSight) -> RenderableType:
    health = sight.health
    if health is None:
        return Text("no figures yet", style="dim")
    if sight.is_health_stale:
        time_of_day = time.strftime("%H:%M:%S", time.localtime(health.time_ns * 1e-9))
        return Text(
            f"health: not known now, last reported at {time_of_day}", style="dim"
        )
    devices = printable(
        ", ".join(f"{d.id} {d.state} {d.rate_hz:.0f} samples/s" for d in health.devices)
    )
    outbox = health.outbox
    return Text(
        f"{devices}; broker {health.broker.state}; {counted(outbox.points, 'point')} "
        "kept, "
        f"{outbox.unsent} to be sent; {health.cpu_share:.0%} of a core, "
        f"{health.rss_bytes / 1e6:.0f} MB",
        style="dim",
    )


def _event(event: Event) -> str:
    time_of_day = time.strftime("%H:%M:%S", time.localtime(event.last_ns * 1e-9))
    ended = " (ended)" if event.active is False else ""
    return printable(f"{time_of_day} {event.source}: {event.text}{ended}")
