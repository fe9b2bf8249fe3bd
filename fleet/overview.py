"""Overview of all arms of a store, those that need attention first."""

import time
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

from traverse.fleet.database import Database
from traverse.fleet.evidence import stored_checks
from traverse.lab.daily_check.chart_pictures import chart_png
from traverse.lab.daily_check.control_chart import EWMA_LIMIT
from traverse.lab.daily_check.report import DailyCheckReport, report_of, report_values
from traverse.lab.outcomes.base import State
from traverse.lab.report.templates import page
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Status

SCHEMA = "traverse/fleet-overview/1"
DAYS = 7
SILENT_S = 60.0
"""An arm that is on line says how it is every few seconds."""
CHECK_DAYS = 1.5
"""After a longer time a daily check is missed."""
MOST_CHARTS = 30
_DAY_NS = 86_400 * 10**9
_ARMS = """SELECT arm.arm, arm.online, arm.state, arm.session, arm.model, arm.version,
    arm.time_ns, arm.status, health.time_ns, health.temperature_c, health.points_unsent
    FROM arm LEFT JOIN health ON health.arm = arm.arm"""
_COUNTS = """SELECT arm, (time_ns - %s) / %s AS day, count(*) FROM standing_point
    WHERE time_ns >= %s GROUP BY arm, day"""
_MISSING = (
    """SELECT arm, count(*) FROM series WHERE gap_since_ns IS NOT NULL GROUP BY arm"""
)
_LOST = """SELECT arm, sum(to_seq - from_seq + 1) FROM lost GROUP BY arm"""
_CERTIFICATES = (
    """SELECT arm, kind, time_ns, verdict FROM certificate ORDER BY time_ns"""
)

Need = Literal["bad", "doubt", "good"]


@dataclass(frozen=True, slots=True)
class Concern:
    """Why an arm needs attention."""

    need: Need
    text: str


def overview_values(
    database: Database, now_ns: int | None = None
) -> tuple[dict[str, Any], dict[str, DailyCheckReport]]:
    """Read everything.

    Returns:
        The overview as plain values, the worst arms first, and the reports of those
        arms that have daily checks.

    Raises:
        StoreAwayError: the database is not there.
    """
    now_ns = time.time_ns() if now_ns is None else now_ns
    today_ns = now_ns - now_ns % _DAY_NS
    since_ns = today_ns - (DAYS - 1) * _DAY_NS
    with database.transaction() as run:
        arms = {row[0]: row[1:] for row in run(_ARMS)}
        counts: dict[str, list[int]] = {}
        for arm, day, n in run(_COUNTS, (since_ns, _DAY_NS, since_ns)):
            if int(day) < DAYS:  # a clock may be ahead
                counts.setdefault(arm, [0] * DAYS)[int(day)] = n
        missing = {arm: int(n) for arm, n in run(_MISSING)}
        lost = {arm: int(n) for arm, n in run(_LOST)}
        certificates = {row[0]: row[1:] for row in run(_CERTIFICATES)}
    reports = {arm: report_of(some) for arm, some in stored_checks(database).items()}
    names = sorted({*arms, *reports, *certificates, *counts})
    arms_values = []
    for name in names:
        values = _arm_values(name, arms.get(name), now_ns)
        values["points_a_day"] = counts.get(name, [0] * DAYS)
        values["series_incomplete"] = missing.get(name, 0)
        values["numbers_lost"] = lost.get(name, 0)
        kind, at_ns, verdict = certificates.get(name, (None, None, None))
        values["certificate"] = kind and {
            "kind": kind,
            "time_utc": _utc(at_ns),
            "verdict": verdict,
        }
        report = reports.get(name)
        values["daily_check"] = None if report is None else report_values(report)
        values["drift"] = None if report is None else _drift(report)
        concerns = _concerns(values, report, now_ns)
        values["need"] = max(
            (concern.need for concern in concerns), key=_RANKS.index, default="good"
        )
        values["concerns"] = [concern.text for concern in concerns]
        arms_values.append(values)
    arms_values.sort(key=lambda of_arm: (-_RANKS.index(of_arm["need"]), of_arm["arm"]))
    heard_utc = [of_arm["heard_utc"] for of_arm in arms_values if of_arm["heard_utc"]]
    values = {
        "schema": SCHEMA,
        "time_utc": _utc(now_ns),
        "database": database.name,
        "heard_utc": max(heard_utc, default=None),
        "arms": arms_values,
    }
    return values, reports


_RANKS: tuple[Need, ...] = ("good", "doubt", "bad")


def _drift(report: DailyCheckReport) -> float | None:
    """Return the largest moving average of a figure over its limit; 1 is an alarm."""
    drifts = [
        abs(chart.last.ewma) / EWMA_LIMIT
        for chart in report.charts
        if chart.last.ewma is not None
    ]
    return max(drifts, default=None)


def _utc(time_ns: int | None) -> str | None:
    if time_ns is None:
        return None
    moment = datetime.fromtimestamp(time_ns // 10**9, UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%SZ}"


def _arm_values(name: str, row: tuple[Any, ...] | None, now_ns: int) -> dict[str, Any]:
    if row is None:
        row = (False, "never heard", None, None, None, None, None, None, None, None)
    online, state, session, model, version, at_ns, status, heard_ns, warm_c, unsent = (
        row
    )
    times_ns = [time_ns for time_ns in (at_ns, heard_ns) if time_ns is not None]
    heard_ns = max(times_ns, default=None)
    is_silent = heard_ns is None or now_ns - heard_ns > SILENT_S * 1e9
    return {
        "arm": name,
        "state": state if not online or not is_silent else "silent",
        "online": bool(online) and not is_silent,
        "session": session,
        "model": model,
        "version": version,
        "heard_utc": _utc(heard_ns),
        "temperature_c": warm_c,
        "points_unsent": unsent,
        "alarms": _alarms(status),
    }


def _alarms(status: bytes | None) -> list[str]:
    if status is None:
        return []
    try:
        latest = decode(Status, bytes(status))
    except MessageError:  # of a version to come
        return []
    return [f"{alarm.source}: {alarm.text}" for alarm in latest.alarms]


def _concerns(
    values: dict[str, Any], report: DailyCheckReport | None, now_ns: int
) -> list[Concern]:
    """List concerns: silent, alarmed, out of control, rejected, lost points."""
    concerns = []
    state = values["state"]
    if state == "silent":
        concerns.append(Concern("bad", f"says nothing since {values['heard_utc']}"))
    elif state == "never heard":
        concerns.append(
            Concern("doubt", "has never been heard by a member of the store")
        )
    elif state != "ready":
        state = {"doubt": "in doubt"}.get(state, state)
        concerns.append(Concern("doubt", f"is {state}"))
    concerns += [Concern("bad", alarm) for alarm in values["alarms"]]
    if values["numbers_lost"]:
        concerns.append(Concern("bad", f"{values['numbers_lost']} points are lost"))
    if values["series_incomplete"]:
        concerns.append(Concern("doubt", "points are missing and have been asked for"))
    if report is None:
        concerns.append(Concern("doubt", "no daily check is known"))
    else:
        concerns += [
            Concern(
                "bad" if reason.state is State.BAD else "doubt",
                f"daily check: {reason.text}",
            )
            for reason in report.outcome.reasons
        ]
    if report is not None:
        last = datetime.fromisoformat(report.checks[-1].time_utc)
        days = (now_ns / 1e9 - last.timestamp()) / 86_400
        if days > CHECK_DAYS:
            concerns.append(Concern("doubt", f"last daily check {days:.0f} days ago"))
    certificate = values["certificate"]
    if certificate is not None and certificate["verdict"] == "reject":
        concerns.append(Concern("bad", "the last verification rejected it"))
    return concerns


def overview_page(
    values: dict[str, Any],
    reports: dict[str, DailyCheckReport],
    refresh_s: int | None = None,
) -> str:
    """Make the page, in one file; the browser may reload it at intervals."""
    checked = [
        name for name in (arm["arm"] for arm in values["arms"]) if name in reports
    ]
    charts = [(arm, chart_png(reports[arm])) for arm in checked[:MOST_CHARTS]]
    return page(
        "fleet/overview.jinja", {}, values=values, charts=charts, refresh_s=refresh_s
    )
