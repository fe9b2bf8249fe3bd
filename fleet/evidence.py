"""Certificates and daily checks of arms, brought into a store as files."""

import hashlib
import json
import sqlite3
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from traverse.fleet.database import Database, Values
from traverse.lab.acceptance.certificate.check import certificate_problems
from traverse.lab.daily_check.figures import DailyCheckFigures
from traverse.lab.daily_check.history import Check, arms_of, checks_of
from traverse.strict_toml.files import bytes_of, json_of
from traverse.strict_toml.problems import FileError, Problem

_CERTIFICATE = """INSERT INTO certificate (digest, arm, kind, time_ns, verdict, file,
    content) VALUES (%s, %s, %s, %s, %s, %s, %s) ON CONFLICT DO NOTHING"""
_CHECK = """INSERT INTO daily_check (arm, data_digest, time_utc, arm_digest, begins,
    figures) VALUES (%s, %s, %s, %s, %s, %s) ON CONFLICT DO NOTHING"""
_CHECKS = """SELECT time_utc, arm, arm_digest, data_digest, begins, figures
    FROM daily_check ORDER BY arm, time_utc, data_digest"""


def add_evidence(database: Database, path: Path) -> str:
    """Bring in a verification, or a history of daily checks; return a description.

    A verification is checked first: digests, and every figure from its data.

    Raises:
        FileError: It is neither, or was altered.
        StoreAwayError: The database is not there.
        OSError: It cannot be read.
    """
    file = path / "certificate.json" if path.is_dir() else path
    if not file.is_file():
        message = "there is no such file; name a verification's folder or interim.db"
        raise FileError(file, message)
    if file.name == "certificate.json":
        if problems := certificate_problems(file):
            raise FileError(path, [Problem("", text) for text in problems])
        rows = list(_certificate_rows(file))
        with database.transaction() as run:
            database.many(run, _CERTIFICATE, rows)
        return f"verification of {rows[0][1]}"
    try:
        checks = [check for arm in arms_of(file) for check in checks_of(file, arm)]
    except sqlite3.Error as error:
        raise FileError(file, str(error)) from error
    rows = [
        (
            *(check.arm, check.data_digest, check.time_utc, check.arm_digest),
            *(check.begins, json.dumps(asdict(check.figures))),
        )
        for check in checks
    ]
    with database.transaction() as run:
        database.many(run, _CHECK, rows)
    return f"daily checks of {', '.join(sorted({check.arm for check in checks}))}"


def _certificate_rows(file: Path) -> Iterator[Values]:
    values = json_of(file)
    moment = datetime.fromisoformat(values["date_utc"]).astimezone(UTC)
    time_ns = int(moment.timestamp()) * 10**9
    arm, verdict = values["arm"]["name"], values["verdict"]
    for name, kind in ((file.name, "verification"), ("dcc.xml", "dcc")):
        if (file.parent / name).is_file():
            content = bytes_of(file.parent / name)
            digest = hashlib.sha256(content).hexdigest()
            yield (digest, arm, kind, time_ns, verdict, name, content)


def stored_checks(database: Database) -> dict[str, list[Check]]:
    """Read all daily checks by arm, in the order in which they were made.

    Raises:
        StoreAwayError: The database is not there.
    """
    with database.transaction() as run:
        rows = run(_CHECKS)
    checks: dict[str, list[Check]] = {}
    for time_utc, arm, arm_digest, data_digest, begins, text in rows:
        figures = DailyCheckFigures(**json.loads(text))
        check = Check(time_utc, arm, arm_digest, data_digest, begins, figures)
        checks.setdefault(arm, []).append(check)
    return checks
