"""The files for systemd, judged by systemd's own programs.

The manual page agrees with the command line.
The rules for devices: as udev would read them.
The programs that set up an environment and a fresh machine, in their parts.

Debian 12 has no `udevadm verify`; the effect of the rules is tested by `make test-vm`.
"""

import importlib.util
import os
import re
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.deploy.places import DEPLOY, output_of, program
from tests.running import run_program
from traverse.cli.__main__ import app

UNIT = DEPLOY / "systemd/traverse@.service"
PAGE = DEPLOY / "systemd/traverse-page@.service"
MOST_EXPOSURE = 2.0
GATEWAY = DEPLOY / "systemd/traverse-gateway@.service"
STORE = DEPLOY / "systemd/traverse-store@.service"
each = pytest.mark.parametrize(
    "file", [UNIT, PAGE, GATEWAY, STORE], ids=lambda file: file.stem
)


def settings(text: str) -> dict[str, list[str]]:
    values: dict[str, list[str]] = {}
    for key, value in re.findall(r"^([A-Za-z]+)=(.*)$", text, re.MULTILINE):
        values.setdefault(key, []).append(value)
    return values


@each
@pytest.mark.needs("systemd")
def test_systemd_understands_every_line_of_a_unit(tmp_path: Path, file: Path) -> None:
    analyze = program("systemd-analyze")
    text = file.read_text("utf-8").replace("/usr/bin/traverse", "/bin/true")
    text = re.sub(r"(?m)^Documentation=.*\n", "", text)
    if not Path("/bin/kill").exists():
        text = text.replace("/bin/kill", "/bin/true")
    unit = tmp_path / f"{file.stem}bench-7.service"
    unit.write_text(text, "utf-8")
    assert output_of(analyze, "--man=no", "verify", unit) == ""


@each
@pytest.mark.needs("systemd")
def test_a_unit_is_shut_as_tightly_as_it_shall_be(tmp_path: Path, file: Path) -> None:
    analyze = program("systemd-analyze")
    shutil.copy(file, tmp_path)
    unit = tmp_path / file.name
    output = output_of(analyze, "security", "--no-pager", "--offline=true", unit)
    figure = re.search(r"exposure level for .*: ([\d.]+)", output)
    assert figure is not None
    assert float(figure[1]) <= MOST_EXPOSURE


def test_the_unit_reloads_by_a_signal_and_is_watched() -> None:
    unit = settings(UNIT.read_text("utf-8"))
    assert unit["Type"] == ["notify"]  # systemd 252 has no notify-reload
    assert unit["ExecReload"] == ["/bin/kill -HUP $MAINPID"]
    assert float(unit["WatchdogSec"][0]) > 0
    assert unit["RestartPreventExitStatus"] == ["2"]  # input refused


@each
def test_secrets_may_be_missing_but_the_token(file: Path) -> None:
    unit = settings(file.read_text("utf-8"))
    loaded = {credential.partition(":")[0] for credential in unit["LoadCredential"]}
    required = {
        Path(credential).name for credential in unit.get("AssertPathExists", ())
    }
    required_of = {PAGE: {"page.token"}, GATEWAY: {"%i"}, STORE: {"%i"}}
    assert required == required_of.get(file, set())
    required &= loaded
    assert loaded - required == {
        credential.partition(":")[0] for credential in unit["SetCredential"]
    }
    assert all(credential.endswith(r":\n") for credential in unit["SetCredential"])


@pytest.mark.needs("systemd")
def test_user_and_groups_can_be_made(tmp_path: Path) -> None:
    sysusers = program("systemd-sysusers")
    (tmp_path / "etc").mkdir()
    file = DEPLOY / "systemd/traverse.sysusers"
    output_of(sysusers, f"--root={tmp_path}", file)
    users = (tmp_path / "etc/passwd").read_text("utf-8")
    assert re.search(r"^traverse:.*:/var/lib/traverse:/usr/sbin/nologin$", users, re.M)
    groups = (tmp_path / "etc/group").read_text("utf-8")
    members = re.findall(r"^(\w+):[^:]*:\d+:traverse$", groups, re.M)
    assert sorted(members) == ["dialout", "gpio", "input"]


@pytest.mark.skipif(os.geteuid() != 0, reason="owners are set by root alone")
@pytest.mark.needs("systemd")
def test_folders_can_be_made(tmp_path: Path) -> None:
    tmpfiles = program("systemd-tmpfiles")
    (tmp_path / "etc").mkdir()
    output_of(program("systemd-sysusers"), f"--root={tmp_path}", sysusers_file())
    file = DEPLOY / "systemd/traverse.tmpfiles"
    output_of(tmpfiles, "--create", f"--root={tmp_path}", file)
    for name in ("etc/traverse", "var/lib/traverse"):
        assert (tmp_path / name).stat().st_mode & 0o777 == 0o750
    assert (tmp_path / "etc/traverse").stat().st_uid == 0
    assert (tmp_path / "var/lib/traverse").stat().st_uid != 0


def sysusers_file() -> Path:
    return DEPLOY / "systemd/traverse.sysusers"


def written() -> str:
    return output_of(sys.executable, DEPLOY / "package/man_page.py")


def test_every_command_and_group_has_its_part() -> None:
    parts = set(re.findall(r"^\.SS traverse (\S+)$", written(), re.MULTILINE))
    names = {
        str(command.name or getattr(command.callback, "__name__", "")).replace(
            "_", "\\-"
        )
        for command in app.registered_commands
        if not command.hidden
    }
    groups = {group.typer_instance.info.name for group in app.registered_groups}
    assert names | groups <= parts


@pytest.mark.needs("groff")
def test_man_prints_it_without_a_warning(tmp_path: Path) -> None:
    page = tmp_path / "traverse.1"
    page.write_text(written(), "utf-8")
    groff = program("groff")
    output = output_of(groff, "-man", "-Tutf8", "-ww", "-b", "-z", page)
    assert output == ""


RULES = DEPLOY / "udev/70-traverse.rules"
PART = re.compile(
    r"(?P<key>[A-Z_]+)(?:\{(?P<name>[\w/]+)\})?(?P<sign>==|!=|\+=|:=|=)"
    r'"(?P<value>[^"]*)"'
)
MATCHED = {"ACTION", "SUBSYSTEM", "SUBSYSTEMS", "KERNEL", "DRIVER", "ENV", "ATTR"}
ASSIGNED = {"GOTO", "LABEL", "SYMLINK", "ENV", "ATTR", "GROUP", "MODE", "IMPORT"}


def rules() -> list[list[re.Match[str]]]:
    """Lines as their parts; a line with anything else in it fails."""
    lines = [
        line
        for line in RULES.read_text("utf-8").splitlines()
        if line and not line.startswith("#")
    ]
    rows = []
    for line in lines:
        parts = [
            PART.fullmatch(part) for part in re.split(r", (?=[A-Z_]+[{=!+:])", line)
        ]
        assert all(parts), line
        rows.append([part for part in parts if part])
    return rows


def test_every_part_is_a_known_match_or_assignment() -> None:
    for part in (part for rule in rules() for part in rule):
        known = MATCHED if part["sign"] in {"==", "!="} else ASSIGNED
        assert part["key"] in known, part[0]


def test_every_jump_has_its_label() -> None:
    parts = [part for rule in rules() for part in rule]
    labels = {part["value"] for part in parts if part["key"] == "LABEL"}
    assert {part["value"] for part in parts if part["key"] == "GOTO"} == labels


def test_names_are_below_one_folder_and_tell_the_serial_number() -> None:
    links = [p["value"] for rule in rules() for p in rule if p["key"] == "SYMLINK"]
    assert all(link.startswith("traverse/") for link in links)
    usb = [link for link in links if "gpio" not in link]
    assert all("$env{ID_SERIAL}" in link for link in usb)


def module_of(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, DEPLOY / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def environment() -> ModuleType:
    return module_of("environment")


def test_the_commands_of_a_fresh_machine_are_those_of_the_readme():
    assert module_of("fresh_machine").readme_commands() == ["make demo", "make test"]


def test_settings_of_pip_are_those_of_uv(environment):
    listed = (
        ":env:.cert='/etc/ssl/bundle.crt'\n"
        "global.find-links='/opt/wheels\\n/opt/more'\n"
        "global.extra-index-url='https://a/simple\\nhttps://b/simple'\n"
        "install.index-url='https://mirror/simple'\n"
        "global.timeout='180'\n"
    )
    assert environment.uv_settings(listed) == {
        "SSL_CERT_FILE": "/etc/ssl/bundle.crt",
        "UV_DEFAULT_INDEX": "https://mirror/simple",
        "UV_EXTRA_INDEX_URL": "https://a/simple https://b/simple",
        "UV_FIND_LINKS": "/opt/wheels,/opt/more",
        "UV_INDEX_STRATEGY": "unsafe-best-match",
    }


def test_markers_of_other_machines_do_not_count(environment, tmp_path):
    lock = tmp_path / "a.lock"
    lock.write_text(
        "# made by make lock\nrich==15.0.0\n    # via typer\n"
        "pywin==1 ; sys_platform == 'win32'\nold==1 ; python_version < '3'\n"
    )
    assert environment.required_packages(lock) == ["rich"]


def test_a_damaged_lock_file_is_named_with_its_line(tmp_path):
    lock = tmp_path / "a.lock"
    lock.write_text("rich==15.0.0\n<<<<<<< HEAD\n")
    ran = run_program(sys.executable, DEPLOY / "environment.py", lock, "demo", status=1)
    assert f"{lock}:2: " in ran.stderr
    assert "run `make lock`" in ran.stderr
    assert "Traceback" not in ran.stderr
