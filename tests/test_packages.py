"""One import root: src/traverse has a link to every package of the checkout."""

import json
import os
import re
import shutil
import sys
import sysconfig
import tomllib
import venv
from pathlib import Path

import pytest

from tests.running import run_program
from traverse.installation import remedy

CHECKOUT = Path(__file__).parent.parent
ROOT = CHECKOUT / "src" / "traverse"
NOT_INSTALLED = {"tests", "benchmarks", "build", "dist", "site"}
PACKAGES = sorted(
    initial.parent.name
    for initial in CHECKOUT.glob("[a-z]*/__init__.py")
    if initial.parent.name not in NOT_INSTALLED
)

# Everything that can be imported, by the names that programs and tests use; then which
# file is loaded under which names.
IMPORT_ALL = """
import importlib, json, os, pkgutil, sys
import traverse, benchmarks

def names(package):
    for module in pkgutil.iter_modules(package.__path__, package.__name__ + "."):
        last = module.name.rpartition(".")[2]
        if last != "__main__" and module.name not in LEFT_OUT:
            yield module.name
            if module.ispkg:
                yield from names(importlib.import_module(module.name))

for package in (traverse, benchmarks):
    for name in names(package):
        try:
            importlib.import_module(name)
        except BaseException as error:
            if type(error).__name__ != "Skipped":  # by pytest.importorskip
                raise
loaded = {}
for name, module in sorted(sys.modules.items()):
    file = getattr(module, "__file__", None)
    if file and name != "__main__":
        loaded.setdefault(os.path.realpath(file), []).append(name)
json.dump(loaded, sys.stdout)
"""
LEFT_OUT = {"benchmarks.peers"}  # with libraries that are not installed beside ours


def test_every_package_is_linked() -> None:
    links = {
        link.name: os.readlink(link) for link in ROOT.iterdir() if link.is_symlink()
    }
    assert links == {name: f"../../{name}" for name in PACKAGES}


def test_the_root_has_nothing_else() -> None:
    entries = {entry.name for entry in ROOT.iterdir() if not entry.is_symlink()}
    assert entries - {"__pycache__"} == {
        "__init__.py",
        "__main__.py",
        "arrays.py",
        "extensions.py",
        "installation.py",
        "plurals.py",
        "py.typed",
    }


def test_every_folder_of_modules_is_a_package() -> None:
    """Else it would be left out of the wheel."""
    folders = {
        module.parent for name in PACKAGES for module in (CHECKOUT / name).rglob("*.py")
    }
    assert [folder for folder in folders if not (folder / "__init__.py").exists()] == []


def test_every_other_file_of_a_package_is_package_data() -> None:
    """Else it would be left out of the wheel."""
    settings = tomllib.loads((CHECKOUT / "pyproject.toml").read_text("utf-8"))
    data = {
        file
        for package, patterns in settings["tool"]["setuptools"]["package-data"].items()
        for pattern in patterns
        for file in (CHECKOUT / "src" / package.replace(".", "/"))
        .resolve()
        .glob(pattern)
    }
    data_files = {
        file
        for name in PACKAGES
        for file in (CHECKOUT / name).rglob("*.*")
        if file.suffix
        in {".css", ".html", ".jinja", ".js", ".json"}
        | {".mplstyle", ".sql", ".template", ".toml", ".xsd"}
    }
    assert len(data_files) > 10
    assert data_files <= data


@pytest.mark.slow
def test_no_module_is_imported_twice_under_two_names() -> None:
    run = run_program(
        sys.executable, "-c", f"LEFT_OUT = {LEFT_OUT!r}\n{IMPORT_ALL}", cwd=CHECKOUT
    )
    loaded: dict[str, list[str]] = json.loads(run.stdout)
    ours = {
        file: names
        for file, names in loaded.items()
        if any(file.startswith(f"{CHECKOUT.resolve() / p}{os.sep}") for p in PACKAGES)
    }
    assert len(ours) > 500
    assert [names for names in ours.values() if len(names) > 1] == []
    assert [n for (n, *_) in ours.values() if not n.startswith("traverse.")] == []


def test_the_old_way_of_importing_is_refused_by_ruff() -> None:
    lines = [
        f"import {package}.planted\nfrom {package} import planted\n"
        for package in PACKAGES
    ]
    checked = run_program(
        *(sys.executable, "-m", "ruff", "check", "--select", "TID251"),
        *("--output-format", "concise", "--stdin-filename", "daemon/planted.py", "-"),
        cwd=CHECKOUT,
        input='"""Planted."""\n\n' + "".join(lines),
        status=1,
    )
    refused = [line for line in checked.stdout.splitlines() if "TID251" in line]
    assert len(refused) == 2 * len(PACKAGES), checked.stdout


def test_what_people_import_is_there_without_the_service() -> None:
    """`Arm` needs neither ports nor files; asking for the root alone loads nothing."""
    program = (
        "import sys, traverse\n"
        "assert 'traverse.client' not in sys.modules\n"
        "from traverse import *\n"
        "from traverse import Arm, BlockingArm, client\n"
        "assert Arm is client.Arm and set(client.__all__) == set(traverse.__all__)\n"
        "print(*(n for n in ('serial', 'mcap', 'scipy', 'typer') if n in sys.modules))"
    )
    run = run_program(sys.executable, "-c", program)
    assert run.stdout.split() == []


@pytest.mark.parametrize(
    ("package", "extra", "words"),
    [
        ("mcap", "daemon", ("run", "daemon.toml")),
        ("serial", "daemon", ("check", "daemon.toml")),
        pytest.param(
            *("serial", "daemon", ("amt21", "scan", "--port", "/dev/null")),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            *("mcap", "daemon", ("export", "points.jsonl")), marks=pytest.mark.slow
        ),
        ("ezdxf", "lab", ("export", "points.jsonl", "--to", "dxf")),
        ("mcap", "lab", ("trace", "points.jsonl")),
    ],
)
def test_a_command_says_which_extra_it_lacks(
    package: str, extra: str, words: tuple[str, ...], tmp_path: Path
) -> None:
    for name in ("points.jsonl", "points.csv", "nominal.toml"):
        (tmp_path / name).touch()
    (tmp_path / "daemon.toml").write_text(
        '[arm]\nfile = "arm.toml"\n[broker]\nhost = "localhost"\n'
        '[[device]]\nid = "base"\ndriver = "latch-board"\nport = "/dev/null"\n'
    )
    program = (
        f"import sys; sys.modules[{package!r}] = None\n"
        "from traverse.cli.__main__ import main; main()"
    )
    run = run_program(sys.executable, "-c", program, *words, cwd=tmp_path, status=2)
    assert f"needs {package}, which is not installed; {remedy(extra)}" in run.stderr
    assert "Traceback" not in run.stderr


HINT = "from traverse.installation import remedy; print(remedy({extra!r}))"


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ("lab", r"sudo apt-get install \./traverse-lab_[\d.]+_\*\.deb$"),
        ("page", r"sudo apt-get install \./traverse_[\d.]+_\*\.deb$"),
        ("parquet", r"sudo apt-get install \./traverse-fleet_[\d.]+_\*\.deb$"),
        ("keys", "the Debian packages do not have it: use `traverse gateway lines`"),
    ],
)
def test_a_debian_package_names_debian_packages(
    extra: str, message: str, tmp_path: Path
) -> None:
    """As installed: an environment of its own in /usr/lib/traverse, without pip."""
    home = tmp_path / "usr/lib/traverse"
    venv.create(home, symlinks=True)
    (site,) = home.glob("lib/python*/site-packages")
    paths = [str(CHECKOUT / "src"), sysconfig.get_path("purelib")]
    (site / "traverse.pth").write_text("\n".join(paths))
    python = home / "bin" / "python3"
    words = [python, "-c", HINT.format(extra=extra)]
    text = run_program(*words).stdout
    assert re.search(message, text.strip())
    assert "pip" not in text


def test_a_checkout_names_make_and_a_wheel_pip(tmp_path: Path) -> None:
    assert remedy("lab") == f"in {CHECKOUT.resolve()} run: make venv"
    package = tmp_path / "traverse"
    package.mkdir()
    for name in ("__init__.py", "installation.py"):
        shutil.copy(ROOT / name, package)
    words = [sys.executable, "-c", HINT.format(extra="lab")]
    run = run_program(*words, cwd=tmp_path)
    named = f"{sys.executable}( -m pip install)? 'traverse-cmm\\[lab\\]'$"
    assert re.search(named, run.stdout.strip())
