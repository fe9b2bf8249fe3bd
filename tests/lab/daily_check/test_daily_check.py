"""The daily check: figures with known results, the history, the report, pictures."""

import contextlib
import json
import sqlite3
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from tests.lab.measurements import (
    OCTAHEDRON,
    artefact,
    limits,
    measured,
    on_a_ball,
    touches,
)
from tests.lab.report.pages import Page
from traverse.kinematics.uncertainty.joint_covariance import JointCovariance
from traverse.lab.daily_check.chart_pictures import (
    chart_lines,
    chart_png,
    write_charts,
)
from traverse.lab.daily_check.figures import (
    MOST_U,
    DailyCheckFigures,
    daily_check_figures,
)
from traverse.lab.daily_check.history import (
    Check,
    HistoryRefusedError,
    add_check,
    checks_of,
)
from traverse.lab.daily_check.report import (
    read_certificate,
    report_of,
    report_values,
)
from traverse.lab.measured_points.measurement import IncompleteError
from traverse.lab.outcomes.base import State
from traverse.strict_toml.problems import FileError

RADIUS_MM = 12.7
# Around the mean: two touches 0.03 away along each axis; s^2 = 6 * 0.03^2 / 5.
SEAT_MM = 0.03 * OCTAHEDRON + [400.0, 0.0, 0.0]
MORE = np.vstack([OCTAHEDRON, np.ones(3) / np.sqrt(3), -np.ones(3) / np.sqrt(3)])
NINE = np.vstack([MORE, [[0.6, 0.8, 0.0]]])


def cone(places_mm=SEAT_MM):
    return artefact("cone", "cone"), touches(places_mm, [""] * len(places_mm))


def ball(outwards=NINE, radius_mm=RADIUS_MM, **keys):
    table = {"radius_mm": RADIUS_MM, **keys}
    places_mm = on_a_ball([500.0, 50.0, 0.0], radius_mm, outwards)
    return artefact("sphere", "sphere", **table), touches(
        places_mm, [""] * len(outwards), 22.0
    )


def test_figures_are_those_by_hand():
    figures = daily_check_figures(measured(cone(), ball(radius_mm=RADIUS_MM + 0.004)))
    assert figures.spat_max_mm == pytest.approx(0.03)
    assert figures.spat_2s_mm == pytest.approx(2 * np.sqrt(6 * 0.03**2 / 5))
    assert figures.sphere_form_mm == pytest.approx(0.0, abs=1e-9)
    assert figures.sphere_diameter_mm == pytest.approx(0.008, abs=1e-9)
    assert (figures.n_cone, figures.n_sphere) == (6, 9)
    assert figures.temperature_c == pytest.approx(22.0)


def test_the_sphere_is_as_large_as_it_is_warm():
    figures = daily_check_figures(measured(cone(), ball(expansion_per_c=1e-4)))
    assert figures.sphere_diameter_mm == pytest.approx(-2 * RADIUS_MM * 1e-4 * 2.0)


def test_what_is_missing_is_reported():
    with pytest.raises(IncompleteError, match="0 artefacts of the kind sphere"):
        daily_check_figures(measured(cone()))
    with pytest.raises(IncompleteError, match="8 touches, expected 9"):
        daily_check_figures(measured(cone(), ball(outwards=MORE)))
    with pytest.raises(IncompleteError, match="radius_mm is missing"):
        daily_check_figures(measured(cone(), ball(radius_mm=RADIUS_MM) and _unknown()))


def _unknown():
    (_, touched) = ball()
    return artefact("sphere", "sphere"), touched


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (
            (cone(np.vstack([SEAT_MM, [453.0, 0.0, 0.0]])), ball()),
            "cone: touch 7 of 7 is 53.0 mm off the others; was it the right seat",
        ),
        (
            (cone(), ball(outwards=np.vstack([NINE, [0.0, 0.0, 1.5]]))),
            "sphere: form .* touch 10 of 10 is farthest off; was it the right sphere",
        ),
        (
            (cone(), ball(radius_mm=10.0)),
            "its diameter is -5.40 mm off the calibrated 25.4 mm; is the radius that",
        ),
    ],
)
def test_a_check_of_something_else_is_no_check(parts, message):
    with pytest.raises(IncompleteError, match=message):
        daily_check_figures(measured(*parts))


def check(day, *, factor=1.0, shift_mm=0.0, begins="", digest="d" * 64, seed=3):
    rng = np.random.default_rng([seed, day])
    noise = np.exp(rng.normal(0.0, 0.15, 3)) * factor
    figures = DailyCheckFigures(
        0.030 * noise[0],
        0.025 * noise[1],
        0.020 * noise[2],
        float(rng.normal(0.001, 0.002)) + shift_mm,
        10,
        9,
        RADIUS_MM,
        20.5,
    )
    time = f"2026-{1 + day // 28:02d}-{1 + day % 28:02d}T08:00:00Z"
    return Check(time, "arm-7", digest, f"{day}", begins, figures)


def test_the_history_keeps_checks_once_and_by_arm(tmp_path):
    path = tmp_path / "interim.db"
    assert checks_of(path, "arm-7") == []
    assert add_check(path, check(1))
    assert add_check(path, check(0))
    assert not add_check(path, check(1))
    assert add_check(path, replace(check(1), arm="other"))
    assert checks_of(path, "arm-7") == [check(0), check(1)]


def test_other_files_are_left_alone(tmp_path):
    text, other, newer = tmp_path / "a", tmp_path / "b", tmp_path / "c"
    text.write_text("no database" * 100)
    with closing(sqlite3.connect(other)) as connection, connection:
        connection.execute("CREATE TABLE mine (x)")
    checks_of(newer, "arm-7")
    with closing(sqlite3.connect(newer)) as connection, connection:
        connection.execute("PRAGMA user_version = 9")
    for path, words in ((text, "no history"), (other, "another"), (newer, "version 9")):
        before = path.read_bytes()
        with pytest.raises(HistoryRefusedError, match=words):
            add_check(path, check(0))
        assert path.read_bytes() == before


def test_a_damaged_history_is_refused_and_nothing_else(tmp_path):
    path, damaged = tmp_path / "interim.db", tmp_path / "damaged.db"
    for day in range(8):
        add_check(path, check(day))
    undamaged, rng = path.read_bytes(), np.random.default_rng(5)
    for _ in range(60):
        content = bytearray(undamaged)
        start = int(rng.integers(len(undamaged)))
        length = int(rng.integers(1, 300))
        content[start : start + length] = rng.bytes(length)
        damaged.write_bytes(content)
        with contextlib.suppress(HistoryRefusedError):
            assert len(checks_of(damaged, "arm-7")) <= 8
    # Not text where the message of SQLite is made of it.
    name = undamaged.index(b"CREATE TABLE checks")
    damaged.write_bytes(undamaged[: name + 20] + b"\xd8" * 40 + undamaged[name + 60 :])
    with pytest.raises(HistoryRefusedError, match="is no history of checks"):
        checks_of(damaged, "arm-7")
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE checks SET spat_2s_mm = x'00' WHERE number = 3")
    with pytest.raises(HistoryRefusedError, match="check 3: spat_2s_mm is b"):
        checks_of(path, "arm-7")


@pytest.mark.parametrize("with_limits", [False, True])
def test_nonsense_is_no_base(with_limits):
    """As an earlier version kept it; and what a certificate does not permit."""
    factor = 6.0 if with_limits else 900.0  # 0.18 mm and more; 27 mm
    permitted = limits(spat_2s_mm=0.1) if with_limits else limits()
    nonsense = [check(day, factor=factor) for day in range(3)]
    report = report_of(nonsense, permitted)
    assert report.outcome.state is State.BAD
    assert report.charts[0].judged.exceeds
    good = report_of([*nonsense, *(check(3 + day) for day in range(12))], permitted)
    assert good.outcome.state is not State.BAD
    assert good.charts[0].last.high < 0.15
    bad = report_of([*good.checks, check(15, factor=4.0)], permitted)
    assert bad.charts[0].last.alarms


def stated(entry, std_mm):
    """Touches whose errors are known, largest along x."""
    of, touched = entry
    n = len(touched.places_mm)
    covariances_mm2 = np.tile(std_mm**2 * np.diag([1.0, 0.25, 0.25]), (n, 1, 1))
    errors = JointCovariance(touched.places_mm, covariances_mm2, np.zeros((n, 3, 0)))
    return of, replace(touched, errors=errors)


def test_the_arm_states_how_uncertain_a_touch_is():
    both = measured(stated(cone(), 0.004), stated(ball(), 0.006))
    assert daily_check_figures(both).stated_mm == pytest.approx(2 * 0.006)
    for entries in ((cone(), stated(ball(), 0.006)), (stated(cone(), 0.004), ball())):
        assert daily_check_figures(measured(*entries)).stated_mm is None


def checks_of_an_arm(stated_mm, n=40):
    checks = [check(day) for day in range(n)]
    return [replace(c, figures=replace(c.figures, stated_mm=stated_mm)) for c in checks]


def test_charts_judge_within_what_the_arm_states_of_itself():
    report = report_of(checks_of_an_arm(0.05))
    assert report.outcome.state is State.GOOD
    assert {chart.judged.permissible_mm for chart in report.charts} == {2.5 * 0.05}
    # An arm of 5 micrometres does not scatter by 30.
    report = report_of(checks_of_an_arm(0.005))
    assert report.outcome.state is State.DOUBT
    assert set(report.outcome.codes) == {"judged"}
    assert "the arm's stated uncertainty allows" in " ".join(report.outcome.sentences)
    permitted = limits(spat_2s_mm=0.1, spat_max_mm=0.1, p_form_mm=0.1, p_size_mm=0.1)
    report = report_of(checks_of_an_arm(0.005), permitted)
    assert report.outcome.state is State.GOOD


def test_a_good_arm_exceeds_what_it_states_once_in_a_hundred_checks():
    rng = np.random.default_rng(4)
    off = rng.normal(size=(20_000, 9))  # nine touches of a sphere, radially
    exceeds = np.ptp(off, axis=1) > MOST_U * 2.0
    assert np.mean(exceeds) == pytest.approx(0.012, abs=0.004)
    seat = rng.normal(size=(20_000, 10, 3))
    seat -= seat.mean(axis=1, keepdims=True)
    two_s = 2.0 * np.sqrt(np.sum(seat**2, axis=(1, 2)) / 9.0)
    largest = np.linalg.norm(seat, axis=2).max(axis=1)
    assert np.mean((two_s > MOST_U * 2.0) | (largest > MOST_U * 2.0)) < 0.005


def test_a_worn_tip_is_noticed_and_a_new_base_begins_after_the_repair():
    good = [check(day) for day in range(40)]
    assert report_of(good).outcome.state is State.GOOD
    worn = [*good, *(check(40 + n, shift_mm=-0.002 * n) for n in range(8))]
    report = report_of(worn)
    values = report_values(report)
    assert values["state"] == "bad"
    assert "control" in {reason["code"] for reason in values["reasons"]}
    assert values["in_control"] is False
    by_key = {figure["key"]: figure for figure in values["figures"]}
    assert by_key["sphere_diameter_mm"]["alarms"]
    assert not by_key["spat_2s_mm"]["alarms"]
    repaired = [*worn, check(48, begins="new tip", digest="e" * 64)]
    again = report_of(repaired)
    assert again.word == "NOT JUDGED YET"
    assert len(again.checks) == 1
    assert "from the third check on" in again.outcome.sentences[0]


def test_all_rules_together_are_about_one_false_alarm_a_year():
    assert 0.5 < 250 * report_of([check(0)]).false_alarms < 1.0


def test_beside_the_acceptance_and_its_limits(tmp_path):
    certificate = {
        "schema": "traverse/acceptance/1",
        "standard": "asme-b89.4.22",
        "date_utc": "2026-01-01T00:00:00Z",
        "arm": {"name": "arm-7", "digest": "f" * 64},
        "figures": [{"key": "spat_2s", "value_mm": 0.028, "limit_mm": 0.02}],
    }
    report = report_of([check(0)], certificate=certificate)
    assert report.charts[0].accepted_mm == pytest.approx(0.028)
    assert report.charts[0].judged.exceeds
    assert report.outcome.state is State.BAD
    assert "another arm file" in report.outcome.sentences[-1]
    wide = report_of([check(0)], limits(spat_2s_mm=0.5), certificate)
    assert wide.outcome.state is State.DOUBT
    # A check is with the arm's own probe, whatever else an acceptance was made with.
    of_own_probe = {**certificate["figures"][0], "tool": "own probe"}
    star = {"key": "spat_2s", "value_mm": 0.5, "limit_mm": 0.02, "tool": "star"}
    both = {**certificate, "figures": [of_own_probe, star]}
    report = report_of([check(0)], certificate=both)
    assert report.charts[0].accepted_mm == pytest.approx(0.028)
    path = tmp_path / "certificate.json"
    path.write_text("{}")
    with pytest.raises(FileError, match="is no certificate"):
        read_certificate(path, "arm-7")
    path.write_text(json.dumps({**certificate, "arm": {}, "digest": {"files": {}}}))
    with pytest.raises(FileError, match="of arm None, expected 'arm-7'"):
        read_certificate(path, "arm-7")


def test_what_nothing_judges_is_not_in_control(tmp_path):
    report = report_of([check(0)])
    assert (report.outcome.state, report.word) == (State.DOUBT, "NOT JUDGED YET")
    assert report_values(report)["in_control"] is False
    write_charts(report, tmp_path)
    assert '<div class="verdict doubt">' in (tmp_path / "chart.html").read_text()
    assert "third check" in report.outcome.sentences[0]
    assert report_of([check(day) for day in range(12)]).word == "in control"


def test_limits_of_metres_judge_nothing_and_what_is_far_outside_is_no_base():
    """The third check has a wrong radius: 0.8 mm are within limits that chance made."""
    checks = [check(0), check(1), check(2, shift_mm=0.8)]
    report = report_of(checks)
    diameter = report.charts[-1]
    assert diameter.last.high > diameter.last.value
    assert report.word == "NOT JUDGED YET"
    codes = [(r.code, r.values["figure"]) for r in report.outcome.reasons]
    assert ("judged", diameter.kind.name) in codes
    later = report_of([*checks, *(check(3 + day) for day in range(12))])
    assert later.word == "in control"
    assert later.charts[-1].last.centre == pytest.approx(0.001, abs=0.003)


def test_a_drift_from_the_first_check_is_not_learned():
    worn = [check(day, shift_mm=0.004 * day) for day in range(14)]
    report = report_of(worn)
    assert report.word == "OUT OF CONTROL"
    assert "steady" in report.outcome.codes
    (reason,) = [entry for entry in report.outcome.reasons if entry.code == "steady"]
    assert reason.values["drift_mm"] == pytest.approx(0.004, rel=0.2)


def test_a_limit_judges_the_first_check():
    permitted = limits(spat_2s_mm=0.2, spat_max_mm=0.2, p_form_mm=0.1, p_size_mm=0.1)
    assert report_of([check(0)], permitted).word == "in control"
    wrong = report_of([check(0, shift_mm=0.8)], permitted)
    assert [reason.code for reason in wrong.outcome.reasons] == ["permitted"]


def test_another_sphere_is_in_doubt():
    checks = [check(day) for day in range(20)]
    other = replace(checks[-1].figures, sphere_radius_mm=12.3)
    report = report_of([*checks[:-1], replace(checks[-1], figures=other)])
    assert [reason.code for reason in report.outcome.reasons] == ["comparable"]
    assert "12.3 mm instead of 12.7 mm" in report.outcome.sentences[0]


def test_pictures_are_made_of_short_and_long_histories(tmp_path):
    assert chart_png(report_of([check(1, factor=9.0)])).startswith(b"\x89PNG")
    report = report_of([check(day) for day in range(69)] + [check(70, factor=9.0)])
    assert write_charts(report, tmp_path) == ["chart.png", "chart.html"]
    page = Page((tmp_path / "chart.html").read_text())
    assert "Computed 2" in page.text
    page.check_is_self_contained()
    assert len(page.pictures) == 1
    assert "OUT OF CONTROL" in page.text
    lines = chart_lines(report.charts[0])
    assert {len(line) for line in lines} == {len(lines[0])}
    assert lines[0].rstrip("|")[-1] == "X"
    assert sum(line.count("o") + line.count("X") for line in lines) == 60
