import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tests import programs
from tests.programs import CHECKOUT, INSTALLER
from tests.running import run_program

NOBODY = "65534"
# What `make test` does not install: a compiler and an emulator for another processor
# (300 MB), and a server of metrics for one of its tools.
OPTIONAL = {"aarch64", "prometheus"}


def groups_of_make_test() -> set[str]:
    text = (CHECKOUT / "Makefile").read_text("utf-8")
    (line,) = re.findall("(?m)^TEST_GROUPS := (.*)$", text)
    return set(line.split())


def test_make_test_installs_every_group_that_a_test_needs():
    marks = {
        group
        for path in (CHECKOUT / "tests").rglob("test_*.py")
        for words in re.findall(r"mark\.needs\(([^)]*)\)", path.read_text("utf-8"))
        for group in re.findall(r'"(\w+)"', words)
    }
    assert marks - OPTIONAL == groups_of_make_test()
    assert marks >= OPTIONAL
    assert marks <= programs.groups().keys()


@pytest.mark.needs("mosquitto")
def test_a_test_finds_programs_of_the_groups_that_it_names(tmp_path):
    assert shutil.which("mosquitto_sub")
    assert shutil.which("git")
    if programs.find("dpkg-query") is None:
        pytest.skip("what every system has is known on Debian alone")
    assert not shutil.which("openssl")
    assert not shutil.which("pytest")


def test_an_unknown_group_is_an_error_that_names_the_installer(tmp_path):
    (tmp_path / "conftest.py").write_text("from tests.conftest import *\n")
    (tmp_path / "test_it.py").write_text(
        "import pytest\n@pytest.mark.needs('gramophone')\ndef test_it(): pass\n"
    )
    ran = run_program(
        *(sys.executable, "-m", "pytest", "-c", CHECKOUT / "pyproject.toml", tmp_path),
        env={**os.environ, "PYTHONPATH": str(CHECKOUT)},
        cwd=tmp_path,
        status=pytest.ExitCode.USAGE_ERROR,
    )
    assert "'gramophone'" in ran.stderr
    assert "debian-packages.sh" in ran.stderr


def installer(
    *words: str, path: str, status: int = 0
) -> subprocess.CompletedProcess[str]:
    drop = ["setpriv", "--clear-groups", f"--reuid={NOBODY}"]
    return run_program(
        *drop if os.geteuid() == 0 else [],
        "sh",
        "-s",
        "--",
        *words,
        input=INSTALLER.read_text("utf-8"),
        env={"PATH": path, "PYTHON": "/usr/bin/python3"},
        cwd="/",
        status=status,
    )


def test_who_may_not_install_is_told_what_is_missing():
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)  # pytest's own folders are shut to others
        path = programs.search_path(frozenset(), Path(folder))
        result = installer("aarch64", "prometheus", path=path, status=2)
        unknown = installer("gramophone", path=path, status=2)
    assert "sudo apt-get install gcc-aarch64-linux-gnu" in result.stderr
    assert result.stderr.endswith(" prometheus\n")
    assert "unknown group 'gramophone'" in unknown.stderr


def test_the_demo_installs_a_part_of_what_developers_have():
    def locked(name: str) -> set[str]:
        text = (CHECKOUT / name).read_text("utf-8")
        return set(re.findall(r"(?m)^[^#\s]+", text))

    assert locked("requirements-demo.lock") < locked("requirements.lock")
