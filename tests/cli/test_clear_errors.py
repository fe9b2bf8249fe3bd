"""Frequent typing errors are named, with the expectation and the remedy."""

import os
import shutil
import socket
import sys
from pathlib import Path

import pytest

import traverse.cli
from tests.campaign_texts import ONE_CONE
from tests.running import invoke, run_program, run_traverse
from traverse.strict_toml.files import lock_alone

ARM = Path(traverse.cli.__file__).parent / "demo_data" / "arm.toml"
DAEMON = """\
[arm]
file = "arm.toml"
[[device]]
id = "base"
driver = "latch-board"
port = "nowhere"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(ARM, tmp_path / "arm.toml")
    (tmp_path / "daemon.toml").write_text(DAEMON)
    (tmp_path / "campaign").mkdir()
    (tmp_path / "campaign" / "campaign.toml").write_text(ONE_CONE)
    (tmp_path / "wire.toml").write_text(ONE_CONE.replace("cone", "draw_wire"))
    (tmp_path / "empty").touch()
    (tmp_path / "there.csv").write_text("mine")
    (tmp_path / "there.mcap").write_text("mine")
    return tmp_path


REFUSED = [
    ("watch --lines --broker localhost:abc", "'localhost:abc': its port is no"),
    ("simulate devices arm.toml", "'traverse/arm/1'; expected 'traverse/simul"),
    ("simulate devices campaign", "Is a directory; expected a file"),
    ("check campaign", "no poses yet: `traverse collect campaign` writes"),
    ("collect wire.toml --arm arm.toml", "'seat' reads a length at every pose"),
    ("check empty", "empty: 1 problem\n  is empty"),
    ("collect empty --arm arm.toml", "schema: is missing; add it"),
    ("collect campaign --arm arm.toml --each ten", "'ten' is not an integer"),
    ("identify campaign --arm arm.toml --out o", "no poses yet: `traverse coll"),
    ("identify arm.toml --arm arm.toml --out o", "Not a directory; expected a f"),
    ("identify campaign --arm arm.toml --out .", "and would be replaced; name"),
    ("diagnose campaign --arm arm.toml --out .", "and would be replaced; name"),
    ("diagnose campaign/campaign.toml --arm arm.toml --plan", "no poses yet"),
    ("verify --plan vdi2617-9 --arm arm.toml --out empty", "empty: File exists; "),
    ("align there.csv --nominal there.csv --std 3mm", "'3mm' is not a number; e"),
    ("export arm.toml --out no/such.csv", "no/such.csv: there is no folder no"),
    ("export empty --out campaign", "campaign is a folder; name a file in it"),
    ("export empty --out there.csv", "there.csv exists; name another, or repla"),
    ("export there.mcap --to csv", "there.csv exists; name another, or replac"),
    ("export there.csv --to csv --force", "there.csv is the source; name anoth"),
    ("export empty", "is no recording (MCAP), no outbox (SQLite) and no points"),
    ("replay there.mcap --out there.mcap", "there.mcap exists; name another"),
    ("replay there.mcap --out there.csv --force", "there.mcap: is no MCAP file"),
    ("points export --db there.mcap --out there.mcap", "there.mcap exists; name"),
    ("points list --db campaign", "campaign: is a folder; name the outbox"),
    ("points list --config no.toml", "no.toml: there is no such file"),
    ("arm from-dh there.csv --out arm.toml", "arm.toml exists; name another, or"),
    ("arm from-urdf empty --out no/arm.toml", "there is no folder no; make it"),
    ("arm to-dh arm.toml --out campaign", "campaign is a folder; name a file"),
    ("confirm --at nan,1,2 --arm-name a", "expected x,y,z in mm, such as 120.5,-30"),
    ("scan start --rate-hz 9 --spacing-mm 1", "--rate-hz or --spacing-mm, not b"),
    ("scan go", "'go' is not one of 'start', 'stop'"),
    ("point --seconds 2s", "'2s' is not a number; expected one, without its un"),
]
UNREACHABLE = [
    ("point --arm-name a --broker localhost:9", "nothing listens there; start it"),
    ("amt21 scan --port there.csv", "ioctl for device; check that this is a ser"),
    ("can scan --channel x --interface no", "python-can has no interface 'no'"),
]


@pytest.mark.parametrize(
    ("words", "status", "expected"),
    [
        *((words, 2, expected) for words, expected in REFUSED),
        *((words, 3, expected) for words, expected in UNREACHABLE),
    ],
)
def test_a_mistake_is_named(
    folder: Path,
    words: str,
    status: int,
    expected: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(folder)
    result = invoke(*words.split(), status=status)
    output = result.stdout + result.stderr
    assert expected in output
    assert "Errno" not in output
    assert "Traceback" not in output
    # Whatever was there still is.
    assert (folder / "arm.toml").read_bytes() == ARM.read_bytes()
    assert {(folder / f"there.{kind}").read_text() for kind in ("csv", "mcap")} == {
        "mine"
    }


@pytest.mark.parametrize(
    ("words", "locked", "expected"),
    [
        ("gateway lines --arm-name a --file there.csv", "there.csv", "appends to it"),
        ("collect campaign --arm arm.toml", "campaign", "collects in it"),
    ],
)
def test_what_another_program_uses_is_refused(
    folder: Path,
    words: str,
    locked: str,
    expected: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(folder)
    descriptor = os.open(locked, os.O_RDONLY)
    lock_alone(descriptor, Path(locked), "")
    result = invoke(*words.split(), status=2)
    os.close(descriptor)
    problem = f"{locked}: another program {expected}; end that program, or name another"
    assert problem in result.stderr


@pytest.mark.parametrize(
    ("module", "swallowed"),
    [
        ("typer", "()"),
        ("typer", "BaseException"),  # as many libraries do
        ("traverse.cli.arm.command", "()"),
        ("traverse.cli.arm.summary", "()"),
    ],
)
def test_ctrl_c_ends_a_command_without_a_traceback(
    folder: Path, module: str, swallowed: str
) -> None:
    """Also while modules are imported, at the start or by the command."""
    code = f"""
import os, signal, sys
class Interrupting:
    def find_spec(self, name, *_):
        if name == {module!r}:
            try:
                os.kill(os.getpid(), signal.SIGINT)
            except {swallowed}:
                pass
sys.meta_path.insert(0, Interrupting())
from traverse.__main__ import main
main()
"""
    words = ("-c", code, "arm", "show", "arm.toml")
    ended = run_program(sys.executable, *words, cwd=folder, status=130)
    assert ended.stderr.strip() == ""


def test_a_file_that_is_no_configuration_is_named(folder: Path) -> None:
    result = run_traverse(folder, "run", "--config", "arm.toml", status=2)
    assert "is a file 'traverse/arm/1'; expected a daemon's" in result.stderr


def test_a_busy_port_of_the_embedded_broker_is_named(folder: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = str(other.getsockname()[1])
        words = ["run", "daemon.toml", "--embedded-broker"]
        result = run_traverse(folder, *words, "--embedded-port", port, status=3)
    expected = f"cannot listen on 127.0.0.1:{port}: Address already in use"
    assert expected in result.stdout + result.stderr


def test_a_busy_port_of_the_page_is_named(folder: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = str(other.getsockname()[1])
        result = run_traverse(
            folder, "page", "--arm-name", "a", "--port", port, status=3
        )
    assert f"127.0.0.1:{port} cannot be listened on" in result.stderr
    assert "choose another --port" in result.stderr
