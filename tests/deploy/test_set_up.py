"""The programs that set up an environment and a fresh machine, in their parts."""

import importlib.util
import sys
from types import ModuleType

import pytest

from tests.deploy.places import DEPLOY
from tests.running import run_program


def program(name: str) -> ModuleType:
    """Load a program of deploy/, which is no package."""
    spec = importlib.util.spec_from_file_location(name, DEPLOY / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def environment() -> ModuleType:
    return program("environment")


def test_the_commands_of_a_fresh_machine_are_those_of_the_readme():
    assert program("fresh_machine").readme_commands() == ["make demo", "make test"]


def test_progress_says_how_many_packages_are_left(environment):
    lines = [
        "Ignoring colorama: markers do not match your environment\n",
        "Collecting numpy==2.4.6 (from -r lock (line 7))\n",
        "  Downloading numpy-2.4.6-cp311-manylinux_2_28_x86_64.whl (16.8 MB)\n",
        "Requirement already satisfied: rich==15.0.0 in ./.venv\n",
        "Processing /wheels/typing_extensions-4.16.0-py3-none-any.whl\n",
        "Installing collected packages: numpy, typing-extensions\n",
    ]
    assert list(environment.progress(iter(lines), 4)) == [
        "  1 of 4 packages, 3 left: numpy",
        "  3 of 4 packages, 1 left: typing_extensions",
        "  unpacking 3 packages",
    ]


def test_markers_of_other_machines_do_not_count(environment, tmp_path):
    lock = tmp_path / "a.lock"
    lock.write_text(
        "# made by make lock\nrich==15.0.0\n    # via typer\n"
        "pywin==1 ; sys_platform == 'win32'\nold==1 ; python_version < '3'\n"
    )
    assert environment.wanted(lock) == ["rich"]


def test_a_damaged_lock_file_is_named_with_its_line(tmp_path):
    lock = tmp_path / "a.lock"
    lock.write_text("rich==15.0.0\n<<<<<<< HEAD\n")
    ran = run_program(sys.executable, DEPLOY / "environment.py", lock, "demo", status=1)
    assert f"{lock}:2: " in ran.stderr
    assert "run `make lock`" in ran.stderr
    assert "Traceback" not in ran.stderr
