"""Files that the daemon reads at its start: which may come later, which are wrong."""

import errno
import os

import pytest

from tests.daemon.values import arm_file
from traverse.daemon.inputs import REFUSED, UNREACHABLE, StartupError, read_inputs

ABSENT = "and/yet/not/mounted"
CONFIGURATION = """\
[arm]
file = "{arm}"
{probes}
[broker]
{broker}
{others}
[[device]]
id = "base"
driver = "latch-board"
port = "/dev/ttyACM0"
"""


def status_and_text(folder, monkeypatch, state="state", **tables):
    arm_file(folder)
    path = folder / "daemon.toml"
    values = {"arm": "arm.toml", "probes": "", "broker": "", "others": "", **tables}
    path.write_text(CONFIGURATION.format(**values))
    monkeypatch.setenv("STATE_DIRECTORY", str(folder / state))
    with pytest.raises(StartupError) as refused:
        read_inputs(path, embedded=False)
    return refused.value.status, str(refused.value)


@pytest.mark.parametrize(
    "tables",
    [
        {"arm": f"{ABSENT}/arm.toml"},
        {"probes": f'probes = "{ABSENT}/probes.toml"'},
        {"broker": f'username = "a"\npassword_file = "{ABSENT}/password"'},
    ],
)
def test_what_is_on_a_disk_that_is_mounted_later_may_come(
    tmp_path, monkeypatch, tables
):
    status, text = status_and_text(tmp_path, monkeypatch, **tables)
    assert status == UNREACHABLE
    assert ABSENT in text


def test_a_mistake_beside_an_absent_file_is_refused(tmp_path, monkeypatch):
    probes, wrong = f'probes = "{ABSENT}/p.toml"', '[assembly]\nclock = "none"'
    status, text = status_and_text(tmp_path, monkeypatch, probes=probes, others=wrong)
    assert status == REFUSED
    assert ABSENT in text
    assert "assembly.clock" in text


@pytest.mark.parametrize("number", [errno.ESTALE, errno.ENOTCONN, errno.EIO])
def test_a_mount_that_has_gone_may_come_back(tmp_path, monkeypatch, number):
    arm_file(tmp_path)
    really_open = os.open

    def opened(name, *rest, **named):  # the system's answer
        if str(name).endswith("arm.toml"):
            raise OSError(number, os.strerror(number), str(name))
        return really_open(name, *rest, **named)

    monkeypatch.setattr(os, "open", opened)
    status, text = status_and_text(tmp_path, monkeypatch)
    assert status == UNREACHABLE
    assert os.strerror(number) in text


@pytest.mark.parametrize("kind", ["file", "below a file", "loop"])
def test_a_state_folder_that_is_none_is_named_with_a_remedy(
    tmp_path, monkeypatch, kind
):
    state = tmp_path / "state"
    if kind == "loop":
        state.symlink_to(state)
    else:
        state.write_text("")
    name = "state/below" if kind == "below a file" else "state"
    status, text = status_and_text(tmp_path, monkeypatch, state=name)
    assert status == UNREACHABLE
    assert f"{tmp_path / name}: 1 problem" in text
    assert "set STATE_DIRECTORY to another" in text
    assert "probe.json" not in text
    wrong = '[assembly]\nclock = "none"'
    status, text = status_and_text(tmp_path, monkeypatch, state=name, others=wrong)
    assert status == REFUSED
    assert "assembly.clock" in text
    assert "STATE_DIRECTORY" in text


def test_something_else_in_the_place_of_a_file_of_the_state_is_refused(
    tmp_path, monkeypatch
):
    (tmp_path / "state").mkdir()
    os.mkfifo(tmp_path / "state" / "probe.json")
    status, text = status_and_text(tmp_path, monkeypatch)
    assert status == REFUSED
    assert "probe.json" in text
    assert "not a regular file" in text
