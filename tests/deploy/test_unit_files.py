"""The files for systemd, judged by systemd's own programs."""

import os
import re
import shutil
from pathlib import Path

import pytest

from tests.deploy.places import DEPLOY, program, said

UNIT = DEPLOY / "systemd/traverse@.service"
PAGE = DEPLOY / "systemd/traverse-page@.service"
MOST_EXPOSURE = 2.0
both = pytest.mark.parametrize("file", [UNIT, PAGE], ids=lambda file: file.stem)


def settings(text: str) -> dict[str, list[str]]:
    """All values of each key of a unit file."""
    found: dict[str, list[str]] = {}
    for key, value in re.findall(r"^([A-Za-z]+)=(.*)$", text, re.MULTILINE):
        found.setdefault(key, []).append(value)
    return found


@both
@pytest.mark.needs("systemd")
def test_systemd_understands_every_line_of_a_unit(tmp_path: Path, file: Path) -> None:
    analyze = program("systemd-analyze")
    text = file.read_text("utf-8").replace("/usr/bin/traverse", "/bin/true")
    text = re.sub(r"(?m)^Documentation=.*\n", "", text)
    if not Path("/bin/kill").exists():
        text = text.replace("/bin/kill", "/bin/true")
    unit = tmp_path / f"{file.stem}bench-7.service"
    unit.write_text(text, "utf-8")
    assert said(analyze, "--man=no", "verify", unit) == ""


@both
@pytest.mark.needs("systemd")
def test_a_unit_is_shut_as_tightly_as_it_shall_be(tmp_path: Path, file: Path) -> None:
    analyze = program("systemd-analyze")
    shutil.copy(file, tmp_path)
    unit = tmp_path / file.name
    told = said(analyze, "security", "--no-pager", "--offline=true", unit)
    figure = re.search(r"exposure level for .*: ([\d.]+)", told)
    assert figure is not None
    assert float(figure[1]) <= MOST_EXPOSURE


def test_the_unit_reloads_by_a_signal_and_is_watched() -> None:
    found = settings(UNIT.read_text("utf-8"))
    assert found["Type"] == ["notify"]  # systemd 252 has no notify-reload
    assert found["ExecReload"] == ["/bin/kill -HUP $MAINPID"]
    assert float(found["WatchdogSec"][0]) > 0
    assert found["RestartPreventExitStatus"] == ["2"]  # input refused


@both
def test_secrets_may_be_missing_but_the_token(file: Path) -> None:
    found = settings(file.read_text("utf-8"))
    loaded = {one.partition(":")[0] for one in found["LoadCredential"]}
    required = {Path(one).name for one in found.get("AssertPathExists", ())}
    assert required == ({"page.token"} if file == PAGE else set())
    assert loaded - required == {
        one.partition(":")[0] for one in found["SetCredential"]
    }
    assert all(one.endswith(r":\n") for one in found["SetCredential"])


@pytest.mark.needs("systemd")
def test_user_and_groups_can_be_made(tmp_path: Path) -> None:
    sysusers = program("systemd-sysusers")
    (tmp_path / "etc").mkdir()
    file = DEPLOY / "systemd/traverse.sysusers"
    said(sysusers, f"--root={tmp_path}", file)
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
    said(program("systemd-sysusers"), f"--root={tmp_path}", sysusers_file())
    file = DEPLOY / "systemd/traverse.tmpfiles"
    said(tmpfiles, "--create", f"--root={tmp_path}", file)
    for name in ("etc/traverse", "var/lib/traverse"):
        assert (tmp_path / name).stat().st_mode & 0o777 == 0o750
    assert (tmp_path / "etc/traverse").stat().st_uid == 0
    assert (tmp_path / "var/lib/traverse").stat().st_uid != 0


def sysusers_file() -> Path:
    """What makes the user."""
    return DEPLOY / "systemd/traverse.sysusers"
