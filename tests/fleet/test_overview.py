import json
import sqlite3
import time
from datetime import UTC, datetime, timedelta

import pytest

from tests.fleet.test_store import point, received
from tests.protocol.message_examples import HEALTH, STATUS
from tests.running import invoke
from traverse.fleet.evidence import add_evidence
from traverse.fleet.gaps import find_gaps
from traverse.fleet.opening import open_database
from traverse.fleet.overview import overview_page, overview_values
from traverse.fleet.scan_files import ScanFiles
from traverse.fleet.store import Store
from traverse.lab.daily_check.figures import DailyCheckFigures
from traverse.lab.daily_check.history import Check, add_check

NOW = datetime(2026, 11, 23, 12, 0, 0, tzinfo=UTC)
NOW_NS = int(NOW.timestamp()) * 10**9
DAY_NS = 86_400 * 10**9
GOOD = STATUS.model_copy(
    update={"state": "ready", "alarms": (), "time_ns": NOW_NS - 10**9}
)
pytestmark = pytest.mark.needs("postgresql")


def history(path, arm, n, drift_mm=0.0, last=NOW):
    """Checks that wander a little; the sphere's diameter drifts from the tenth on."""
    for number in range(n):
        moment = last - timedelta(days=n - 1 - number)
        small = 0.001 * ((7 * number) % 5)
        figures = DailyCheckFigures(
            spat_2s_mm=0.03 + small,
            spat_max_mm=0.04 + small,
            sphere_form_mm=0.02 + small,
            sphere_diameter_mm=small + drift_mm * max(0, number - 10),
            n_cone=10,
            n_sphere=10,
            sphere_radius_mm=12.5,
            temperature_c=20.0,
        )
        time_utc = f"{moment:%Y-%m-%dT%H:%M:%SZ}"
        check = Check(time_utc, arm, "a" * 64, f"{arm}-{number}", "", figures)
        add_check(path, check)


def store_messages(database, tmp_path, *messages):
    store = Store(database, ScanFiles(str(tmp_path / "scans"), "m"))
    store.write([received(message, arm) for arm, message in messages])
    assert store.n_refused == 0


def health(**changes):
    return HEALTH.model_copy(update={"time_ns": NOW_NS - 10**9, **changes})


def test_a_good_arm_has_nothing_against_it(database, tmp_path):
    warm = health(temperatures_c={"arm": 20.4})
    points = [point(n, time_ns=NOW_NS - 1000 * n) for n in range(3)]
    before = point(3, time_ns=NOW_NS - 2 * DAY_NS)
    messages = [("a", m) for m in (GOOD, warm, *points, before)]
    store_messages(database, tmp_path, *messages)
    history(tmp_path / "interim.db", "a", 15)
    assert add_evidence(database, tmp_path / "interim.db") == "daily checks of a"
    add_evidence(database, tmp_path / "interim.db")  # once is enough
    values, reports = overview_values(database, NOW_NS)
    (arm,) = values["arms"]
    assert (arm["need"], arm["concerns"], arm["state"]) == ("good", [], "ready")
    assert arm["points_a_day"] == [0, 0, 0, 0, 1, 0, 3]
    assert arm["temperature_c"] == 20.4
    assert arm["daily_check"]["in_control"]
    assert arm["daily_check"]["checks"] == 15
    assert 0.0 <= arm["drift"] < 1.0
    page = overview_page(values, reports, 5)
    assert 'content="5"' in page
    assert "Daily checks of a" in page


@pytest.mark.parametrize(
    ("change", "need", "expected"),
    [
        ({"state": "degraded"}, "doubt", "is degraded"),
        ({"online": False, "state": "offline"}, "doubt", "is offline"),
        ({"alarms": STATUS.alarms}, "bad", STATUS.alarms[0].text),
        (
            {"time_ns": NOW_NS - 120 * 10**9},
            "bad",
            "says nothing since 2026-11-23T11:58",
        ),
    ],
)
def test_what_is_not_as_it_should_be_is_said_and_comes_first(
    database, tmp_path, change, need, expected
):
    bad = GOOD.model_copy(update=change)
    old = health(time_ns=NOW_NS - 120 * 10**9)
    messages = [("a", GOOD), ("a", health()), ("b", bad), ("b", old)]
    if "time_ns" not in change:
        messages[-1] = ("b", health())
    store_messages(database, tmp_path, *messages)
    history(tmp_path / "i.db", "a", 15)
    history(tmp_path / "i.db", "b", 15)
    add_evidence(database, tmp_path / "i.db")
    first, second = overview_values(database, NOW_NS)[0]["arms"]
    assert (first["arm"], first["need"]) == ("b", need)
    assert any(expected in concern for concern in first["concerns"])
    assert (second["arm"], second["need"]) == ("a", "good")


def test_a_check_that_drifts_or_is_old_is_said(database, tmp_path):
    history(tmp_path / "i.db", "drifting", 25, drift_mm=0.001)
    history(tmp_path / "i.db", "old", 15, last=NOW - timedelta(days=4))
    history(tmp_path / "i.db", "new", 2)
    add_evidence(database, tmp_path / "i.db")
    arms = {arm["arm"]: arm for arm in overview_values(database, NOW_NS)[0]["arms"]}
    assert arms["drifting"]["need"] == "bad"
    assert arms["drifting"]["drift"] > 1.0
    assert any("EWMA" in arm for arm in arms["drifting"]["concerns"])
    assert "last daily check 4 days ago" in arms["old"]["concerns"]
    assert any(
        "judges from the third" in concern for concern in arms["new"]["concerns"]
    )
    assert all("has never been heard" in arm["concerns"][0] for arm in arms.values())


def test_lost_and_missing_points_are_said(database, tmp_path):
    store_messages(database, tmp_path, ("a", GOOD), ("a", health()), ("a", point(5)))
    with database.transaction() as run:
        run("INSERT INTO lost VALUES ('a', 's', '', 0, 3, 1, 'gone')")
    assert len(find_gaps(database, NOW_NS)) == 1
    (arm,) = overview_values(database, NOW_NS)[0]["arms"]
    assert (arm["numbers_lost"], arm["series_incomplete"]) == (4, 1)
    assert "4 points are lost" in arm["concerns"]


def run(*words, status=0):
    return invoke("fleet", *words, status=status)


def test_commands(tmp_path):
    url = tmp_path / "store.db"
    result = run("overview", "--database", url, status=2)
    assert "`traverse store` makes one" in result.output
    history(tmp_path / "i.db", "a", 15, last=datetime.now(UTC))
    added = run("add", tmp_path / "i.db", "--database", url)
    assert "daily checks of a" in added.output
    repeated = run("add", tmp_path / "i.db", "--database", url, "--json")
    (entry,) = json.loads(repeated.stdout)["added"]
    assert entry == {"file": str(tmp_path / "i.db"), "holds": "daily checks of a"}
    opened = open_database(str(url))
    now_ns = time.time_ns()
    store_messages(
        opened,
        tmp_path,
        ("a", GOOD.model_copy(update={"time_ns": now_ns})),
        ("a", health(time_ns=now_ns)),
    )
    opened.close()
    shown = run("overview", "--database", url, "--out", tmp_path / "o.html")
    assert shown.output.startswith("a: ready, 0 points today\n")
    values = json.loads(run("overview", "--database", url, "--json").stdout)
    assert values["schema"] == "traverse/fleet-overview/1"
    with sqlite3.connect(url) as connection:
        connection.execute("INSERT INTO lost VALUES ('a', 's', '', 0, 3, 1, 'gone')")
    connection.close()
    run("overview", "--database", url, status=1)


def test_an_altered_certificate_is_refused(tmp_path):
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "certificate.json").write_text('{"schema": "x"}')
    (tmp_path / "other.db").write_bytes(b"no database at all, but long enough" * 99)
    for file, expected in (
        (tmp_path / "c", "is no certificate"),
        (tmp_path / "other.db", "is no history of checks"),
        (tmp_path / "absent.db", "absent.db"),
    ):
        ran = run("add", file, "--database", tmp_path / "store.db", status=2)
        assert expected in ran.output
        assert "Traceback" not in ran.output
