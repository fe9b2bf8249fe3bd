import json
from datetime import UTC, datetime

import numpy as np
import pytest

from tests.docs.pages import CHECKOUT
from tests.running import invoke
from traverse.kinematics.arm_file.arm import read_arm
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.daily_check.figures import write_check

ARM = CHECKOUT / "cli" / "demo_data" / "arm.toml"
RADIUS_MM = 12.7


def campaign(folder, *, day, scatter_mm=0.01, missing=0):
    """A check whose joint angles are found by Newton's steps from a fixed posture."""
    arm = read_arm(ARM)
    write_check(folder, arm, RADIUS_MM, datetime(2026, 3, day + 1, 8, tzinfo=UTC))
    geometry = geometry_from_arm(arm)
    rng = np.random.default_rng(day)
    names = [joint.name for joint in arm.joints]
    angles = np.array([joint.zero_rad for joint in arm.joints], dtype=float)
    angles += np.array([0.3, 0.6, 0.2, -0.8, 0.3, 0.7, 0.1])[: len(names)]
    start_mm = probe_centre(geometry, angles[np.newaxis])[0]
    ways = rng.normal(size=(9, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, np.newaxis]
    tip_mm = arm.probe.radius_mm
    expected = [("cone", side, np.zeros(3)) for side in 5 * ["left"] + 5 * ["right"]]
    expected += [("sphere", "", (RADIUS_MM + tip_mm) * way) for way in ways]
    lines = ["time_s,artefact,feature," + ",".join(f"{n}_rad" for n in names)]
    for row, (artefact, feature, offset_mm) in enumerate(expected[missing:]):
        target_mm = start_mm + offset_mm + rng.normal(0, scatter_mm, 3)
        posture = angles.copy()
        for _ in range(8):
            here_mm = probe_centre(geometry, posture[np.newaxis])[0]
            steps = posture + 1e-7 * np.eye(len(posture))
            slope = (probe_centre(geometry, steps) - here_mm).T / 1e-7
            posture = posture + np.linalg.pinv(slope) @ (target_mm - here_mm)
        numbers = ",".join(repr(float(a)) for a in posture)
        lines.append(f"{row},{artefact},{feature},{numbers}")
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture
def run(tmp_path):
    def run(*words, status=0):
        options = ["--arm", str(ARM), "--history", str(tmp_path / "interim.db")]
        return invoke("daily-check", *options, *words, status=status)

    return run


@pytest.mark.slow
def test_checks_go_into_the_history_and_a_bad_one_is_found(run, tmp_path):
    run("--show", "--strict", status=2)
    for day in range(6):
        folder = campaign(tmp_path / f"day-{day}", day=day)
        result = run("--campaign", folder, "--json")
        check = json.loads(result.stdout)
        assert check["checks"] == day + 1
        # Limits of so few checks are as wide as chance makes them.
        assert check["state"] != "bad", check["reasons"]
        assert check["in_control"] is (check["state"] == "good")
        if day == 0:
            assert check["state"] == "doubt"
    assert check["time_utc"] == "2026-03-06T08:00:00Z"
    by_key = {figure["key"]: figure["value_mm"] for figure in check["figures"]}
    # sigma 0.01 mm an axis: 2 s is 2 sqrt(3) times that.
    assert by_key["spat_2s_mm"] == pytest.approx(0.035, rel=0.5)
    assert abs(by_key["sphere_diameter_mm"]) < 0.03
    repeated = run("--campaign", folder)
    assert "counted before" in repeated.stderr
    bad = campaign(tmp_path / "bad", day=7, scatter_mm=0.5)
    result = run("--campaign", bad, "--out", tmp_path / "charts", status=1)
    assert "OUT OF CONTROL" in result.output
    assert "articulation, 2 s: one check above 3.5 sigma." in result.output
    assert (tmp_path / "charts" / "chart.png").stat().st_size > 10_000
    assert run("--show", status=1).output == result.output
    # Of those before it only, though computed after a bad one.
    late = run("--campaign", campaign(tmp_path / "late", day=6), "--json")
    assert json.loads(late.stdout)["time_utc"] == "2026-03-07T08:00:00Z"
    assert json.loads(run("--show", "--json", status=1).stdout)["state"] == "bad"


def test_an_incomplete_check_is_not_counted(run, tmp_path):
    result = run("--campaign", campaign(tmp_path / "half", day=1, missing=7), status=1)
    assert "3 touches, expected 5 or more" in result.stderr
    run("--show", status=2)


def test_nonsense_is_not_counted(run, tmp_path):
    result = run(
        "--campaign", campaign(tmp_path / "off", day=1, scatter_mm=9.0), status=1
    )
    assert "off the others; was it the right seat?" in result.stderr
    run("--show", status=2)


def test_copies_are_no_touches(run, tmp_path):
    folder = campaign(tmp_path / "copies", day=1)
    head, first, _, *others = (folder / "poses.csv").read_text().splitlines()
    again = first.replace("0,", "1,", 1)
    (folder / "poses.csv").write_text("\n".join([head, first, again, *others]) + "\n")
    result = run("--campaign", folder, status=1)
    assert "1 of the touches lie exactly where another does" in result.stderr
    run("--show", status=2)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--show"], "has no check"),
        ([], "--radius missing"),
        (["--show", "--config", "x.toml"], "one of them"),
        (["--campaign", "nowhere"], "nowhere"),
    ],
)
def test_refusals(run, words, message):
    result = run(*words, status=2)
    assert message in result.stderr


def test_a_history_that_is_a_folder_is_refused_with_what_is_expected(tmp_path):
    words = ["daily-check", "--arm", str(ARM), "--history", str(tmp_path), "--show"]
    done = invoke(*words, status=2)
    assert f"{tmp_path}: is not a file; expected the SQLite file" in done.stderr


def test_its_former_name_does_the_same(tmp_path):
    words = ("--arm", tmp_path / "no-arm.toml", "--history", tmp_path / "h.db")
    printed, of_former = (
        invoke(name, *words, "--show", status=2).output
        for name in ("daily-check", "interim")
    )
    assert printed.replace("daily-check", "interim") == of_former
