import json
import os
import shutil
import sys
from pathlib import Path

import pytest

from tests.running import run_program

CHECKOUT = Path(__file__).parents[1]
TEMPLATE = CHECKOUT / "examples" / "extension"
DAEMON = """
[arm]
name = "bench-7"
file = "arm.toml"

[[device]]
id = "base"
driver = "ascii-hub"
port = "/dev/ttyUSB0"
counts_per_turn = [4096, 4096]
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    source = tmp_path_factory.mktemp("source") / "extension"
    shutil.copytree(TEMPLATE, source)
    site = tmp_path_factory.mktemp("site")
    words = ("install", "-q", "--no-deps", "--no-build-isolation", "--no-index")
    run_program(sys.executable, "-m", "pip", *words, "--target", site, source)
    return site


def run(site: Path, *words: object, status: int | None = 0, cwd: Path = CHECKOUT):
    environment = os.environ | {"PYTHONPATH": str(site), "OPENBLAS_NUM_THREADS": "1"}
    return run_program(
        *(sys.executable, "-m", *words), status=status, env=environment, cwd=cwd
    )


def offers(site: Path, status: int = 0) -> dict[tuple[str, str], str]:
    listed = run(site, "traverse", "extensions", "--json", status=status)
    return {(o["group"], o["name"]): o["problem"] for o in json.loads(listed.stdout)}


def package(site: Path, name: str, entry_points: str, **modules: str) -> None:
    """Put an installed package into a folder, as pip would leave it."""
    info = site / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
    )
    (info / "entry_points.txt").write_text(entry_points)
    for module, text in modules.items():
        (site / f"{module}.py").write_text(text)


def test_all_that_the_template_offers_can_be_used(installed):
    assert offers(installed) == {
        ("drivers", "ascii-hub"): "",
        ("exports", "asc"): "",
        ("effects", "half_wave"): "",
        ("simulator_laws", "half_wave"): "",
        ("gateways", "json-lines"): "",
    }


def test_the_page_shows_what_is_printed(installed):
    page = CHECKOUT / "docs" / "how-to" / "extend-traverse.md"
    printed = run(installed, "traverse", "extensions").stdout
    shown = page.read_text("utf-8").partition("$ traverse extensions\n")[2]
    lines = shown.partition("```")[0].splitlines()
    assert [line.strip() for line in lines if line.strip()] == printed.splitlines()


def test_its_driver_keeps_the_contract(installed):
    ran = run(installed, "pytest", "-q", "-p", "no:cacheprovider", TEMPLATE / "tests")
    assert "9 passed" in ran.stdout


def test_its_driver_is_configured_like_any_other(installed, tmp_path):
    file = tmp_path / "daemon.toml"
    file.write_text(DAEMON + "answer_timeout_s = 9.0\nbauds = 1\n")
    problems = json.loads(
        run(installed, "traverse", "check", file, "--json", status=2).stdout
    )["problems"]
    where = {problem["where"].rpartition(".")[2] for problem in problems}
    assert {"answer_timeout_s", "bauds"} <= where


def test_its_gateway_has_its_options_and_those_of_all(installed):
    shown = run(installed, "traverse", "gateway", "json-lines", "--help").stdout
    assert "Print points as lines of JSON" in shown
    for option in ("--arm-name", "--broker", "--since", "--unit", "--with-doubtful"):
        assert option in shown
    assert (
        "traverse-example 0.1.0"
        in run(installed, "traverse", "gateway", "--help").stdout
    )


@pytest.mark.slow
def test_its_effect_is_read_played_and_a_candidate(installed):
    walks = ("walk_arm_file", "walk_simulator", "walk_candidates", "walk_docs")
    ran = run(installed, "tests.lab.planted_kind", *walks)
    assert json.loads(ran.stdout) == dict.fromkeys(walks, "passed")


def test_a_package_that_cannot_be_imported_is_named(tmp_path):
    entries = "[traverse.drivers]\nbad = bad_module:Driver\n"
    package(tmp_path, "bad-package", entries, bad_module="import no_such_library\n")
    (problem,) = offers(tmp_path, status=1).values()
    assert "package bad-package 1.0" in problem
    assert "no_such_library" in problem
    file = tmp_path / "daemon.toml"
    file.write_text(DAEMON.replace("ascii-hub", "bad"))
    shown = run(tmp_path, "traverse", "check", file, status=2)
    assert "bad-package 1.0" in shown.stdout + shown.stderr
    assert "Traceback" not in shown.stderr


def test_what_cannot_be_used_is_refused_by_its_package(tmp_path):
    for name, group, module in (
        ("number", "drivers", "bad = 7\n"),
        ("plain-class", "drivers", "class bad: pass\n"),
        ("function", "exports", "def bad(): pass\n"),
        ("other-kind", "effects", "class bad: kind = 'other'\n"),
        ("one-argument", "gateways", "def bad(arm): pass\n"),
    ):
        made = name.replace("-", "_")
        entries = f"[traverse.{group}]\n{name} = {made}:bad\n"
        package(tmp_path, name, entries, **{made: module})
    for name in ("first", "second"):
        entries = f"[traverse.exports]\nasc = {name}:Asc\n"
        package(tmp_path, name, entries, **{name: "class Asc: pass\n"})
    problems = offers(tmp_path, status=1)
    assert len(problems) == 6
    twice = problems.pop(("exports", "asc"))
    assert "first 1.0" in twice
    assert "second 1.0" in twice
    for (_, name), problem in problems.items():
        assert f"package {name} 1.0, {name.replace('-', '_')}:bad" in problem


def test_names_of_traverse_cannot_be_taken(tmp_path):
    entries = (
        "[traverse.exports]\ncsv = thief:Csv\n[traverse.gateways]\nlines = thief:go\n"
    )
    package(tmp_path, "thief", entries, thief="raise SystemExit(9)\n")
    problems = offers(tmp_path, status=1)
    assert set(problems.values()) == {"not used: Traverse has one of that name"}
    shown = run(tmp_path, "traverse", "gateway", "lines", "--help").stdout
    assert "--template" in shown


@pytest.mark.slow
def test_an_effect_without_a_law_is_applied_and_cannot_be_played(tmp_path):
    effect = (TEMPLATE / "src" / "traverse_example" / "effect.py").read_text()
    entries = "[traverse.effects]\nhalf_wave = lawless:HalfWave\n"
    package(tmp_path, "lawless", entries, lawless=effect)
    walks = ("walk_arm_file", "walk_simulator")
    results = json.loads(run(tmp_path, "tests.lab.planted_kind", *walks).stdout)
    assert results["walk_arm_file"] == "passed"
    assert "has no law for the simulator" in results["walk_simulator"]
