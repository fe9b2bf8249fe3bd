"""What is often typed wrong is named, with what was expected and what to do."""

import shutil
import socket
from pathlib import Path

import pytest

import traverse.cli
from tests.cli.programs import run_traverse

ARM = Path(traverse.cli.__file__).parent / "demo_data" / "arm.toml"
DAEMON = """\
[arm]
file = "arm.toml"
[[device]]
id = "base"
driver = "latch-board"
port = "nowhere"
"""
CAMPAIGN = """\
schema = "traverse/campaign/1"
poses = "poses.csv"
[[artefacts]]
id = "seat"
kind = "cone"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(ARM, tmp_path / "arm.toml")
    (tmp_path / "daemon.toml").write_text(DAEMON)
    (tmp_path / "campaign").mkdir()
    (tmp_path / "campaign" / "campaign.toml").write_text(CAMPAIGN)
    (tmp_path / "wire.toml").write_text(CAMPAIGN.replace("cone", "draw_wire"))
    return tmp_path


@pytest.mark.parametrize(
    ("words", "status", "expected"),
    [
        ("watch --lines --broker localhost:abc", 2, "'localhost:abc': its port is no"),
        ("run --config arm.toml", 2, "this is a file 'traverse/arm/1'; expected a dae"),
        ("check campaign", 2, "no poses yet: `traverse collect campaign` writes"),
        ("collect wire.toml --arm arm.toml", 2, "'seat' reads a length at every pose"),
        ("export arm.toml --out no/such.csv", 2, "no: there is no such folder; make"),
    ],
)
def test_a_mistake_is_named(
    folder: Path, words: str, status: int, expected: str
) -> None:
    result = run_traverse(folder, *words.split())
    assert result.returncode == status
    assert expected in result.stdout + result.stderr
    assert "Errno" not in result.stdout + result.stderr


def test_a_busy_port_of_the_embedded_broker_is_named(folder: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = str(other.getsockname()[1])
        words = ["run", "--config", "daemon.toml", "--embedded-broker"]
        result = run_traverse(folder, *words, "--embedded-port", port)
    assert result.returncode == 3
    expected = f"cannot listen on 127.0.0.1:{port}: Address already in use"
    assert expected in result.stdout + result.stderr
