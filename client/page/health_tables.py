"""Health and coverage as HTML."""

import time
from html import escape

import numpy as np

from traverse.client.display.arm_state import SECTORS, ArmSight
from traverse.client.display.condition import condition_words, lost_conditions
from traverse.plurals import counted

WORDS = {"ready": "good", "connected": "good", "starting": "warning"}


def health_table(sight: ArmSight) -> str:
    health = sight.health
    if health is None:
        return "<p>No figures yet.</p>"
    old = sight.is_health_stale
    rows = []

    def state(text: str) -> str:
        return "" if old else text  # what was well is not said to be so now

    for device in health.devices:
        age_s = device.age_s
        age = "no data" if age_s is None else f"data {age_s:.1f} s ago"
        figures = f"{device.rate_hz:.0f} samples/s, {age}"
        rows.append(_row(_untranslated(device.id), state(device.state), figures))
        rows += [
            _row(_untranslated(f"{device.id} {name}"), "", f"{value:.1f} °C")
            for name, value in device.temperatures_c.items()
        ]
    broker, outbox = health.broker, health.outbox
    address = _untranslated(f"{broker.host}:{broker.port}")
    rows.append(_row("broker", state(broker.state), address))
    waits = (
        f"{counted(outbox.points, 'point')} kept, {outbox.unsent} waiting for the "
        "broker"
    )
    rows.append(_row("disk", state(outbox.state), waits))
    names = {
        "capture_to_publish": "trigger to handing over",
        "point_to_disk": "point to disk",
        "publish_to_ack": "broker's answer",
        "sample_to_pose": "sample to pose",
    }
    for name, words in names.items():
        delay = health.latencies.get(name)
        if delay is not None:
            figures = (
                f"{delay.p50_us / 1e3:.1f} ms, 99 % within {delay.p99_us / 1e3:.1f}"
            )
            rows.append(_row(words, "", figures))
    lost = {
        words: health.counters.get(name, 0)
        for name, words in (
            ("samples_lost", "samples lost"),
            ("scan_points_dropped", "scan points dropped"),
            ("points_refused", "points refused"),
        )
    }
    rows += [_row(words, "warning", str(n)) for words, n in lost.items() if n]
    memory = f"{health.cpu_share:.0%} of a core, {health.rss_bytes / 1e6:.0f} MB"
    rows.append(_row("daemon", "", memory))
    time_of_day = time.strftime("%H:%M:%S", time.localtime(health.time_ns * 1e-9))
    notice = f"<p><b>Out of date:</b> figures of {time_of_day}.</p>" if old else ""
    kind = "plain wrap old" if old else "plain wrap"
    return f'{notice}<table class="{kind}"><tbody>{"".join(rows)}</tbody></table>'


def condition_list(sight: ArmSight) -> str:
    status = sight.status
    is_heard = sight.is_online and not sight.is_silent
    if status is None or not is_heard or not status.conditions:
        return ""
    items = [
        f'<p class="state warning">{escape(condition_words(lost))}<br>'
        f"<small>{escape(lost.remedy)}</small></p>"
        for lost in lost_conditions(sight)
    ]
    n = len(status.conditions)
    heading = (
        f"{n - len(items)} of {counted(n, 'condition')} of a good number established"
    )
    return f"<p>{heading}</p>{''.join(items)}"


def alarm_list(sight: ArmSight) -> str:
    """Return active conditions, and the latest past ones."""
    items = [
        f'<p class="state {"bad" if e.severity == "error" else "warning"}">'
        f"{escape(e.text)}<br><small>{escape(e.remedy)}</small></p>"
        for e in sight.alarms.values()
        if e.severity != "info"
    ]
    past = [e for e in sight.events if e.active is not True and e.severity != "info"]
    for event in past[:-6:-1]:
        time_of_day = time.strftime("%H:%M:%S", time.localtime(event.last_ns * 1e-9))
        items.append(f"<p><small>{time_of_day} {escape(event.text)}</small></p>")
    return "".join(items)


def coverage_bars(sight: ArmSight) -> str:
    coverage = sight.coverage
    if coverage is None or sight.live is None:
        return "<p>No pose yet.</p>"
    is_now = not sight.is_stale
    bars = []
    for joint, sectors in enumerate(coverage):
        angle_rad = sight.live.angles_rad[joint]
        rects = "".join(
            f'<rect class="seen" x="{i}" y="0" width="1" height="1"/>'
            for i in np.flatnonzero(sectors)
        )
        if is_now:
            sector = np.mod(angle_rad / (2.0 * np.pi), 1.0) * SECTORS
            rects += (
                f'<rect class="here" x="{sector - 0.2:.2f}" y="0" width=".4" '
                'height="1"/>'
            )
        part = np.count_nonzero(sectors) / SECTORS
        angle = f"{np.degrees(angle_rad):z.3f}°"
        bars.append(
            f'<div class="sectors"><span>J{joint + 1}</span>'
            f'<svg viewBox="0 0 {SECTORS} 1" preserveAspectRatio="none" role="img" '
            f'aria-label="joint {joint + 1} has been in {part:.0%} of a turn">'
            f"{rects}</svg><b>{angle}</b><span>{part:.0%}</span></div>"
        )
    return "".join(bars)


def _untranslated(name: str) -> str:
    return f'<span translate="no">{escape(name)}</span>'


def _row(name: str, state: str, figures: str) -> str:
    """Return a row of a table; name and figures are HTML."""
    kind = WORDS.get(state, "bad" if state not in ("", "warning") else state)
    shown = state if state not in ("", "warning") else ""
    strong = "state warning" if kind == "warning" and not shown else ""
    return (
        f'<tr><td class="text">{name}</td>'
        f'<td class="text state {kind}">{escape(shown)}</td>'
        f'<td class="text {strong}">'
        f"{figures}</td></tr>"
    )
