"""Every command that reports has `--json`: one document, or one a line, and no more."""

import json
import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main

from tests.client.virtual_daemon import RECORDED, VirtualDaemon
from tests.docs.pages import CHECKOUT
from tests.end_to_end.programs import Program
from tests.mosquitto import Mosquitto
from tests.protocol.message_examples import POINT
from tests.running import invoke
from traverse.cli.__main__ import app
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.outbox import message_of
from traverse.kinematics.arm_file.arm import read_arm
from traverse.protocol.encoding import encode
from traverse.simulator.campaigns import (
    CampaignSpec,
    draw_noise,
    make_poses,
    write_campaign,
)

WITHOUT = {
    "run": "a service: what it does is its log, as JSON with --log-format json",
    "simulate devices": "hardware: it prints which ports are ready, for programs",
    "simulate campaign": "files, of which it prints how many poses they have",
    "simulate scan": "files, of which it prints how many samples they have",
    "help": "text for people",
    "demo": "shown to people; `traverse watch --json` beside it follows its arm",
    "page": "a server for browsers",
    "setup": "a server for browsers",
    "store": "a service; what it stores is in a database",
    "gateway ippdme": "a server for metrology software",
    "gateway lines": "its lines have the form that is asked for",
    "gateway keys": "what it types has the form that is asked for",
    "gateway live": "a server for viewers",
    "gateway opcua": "a server for clients of OPC UA",
    "gateway home-assistant": "a service; what it publishes is JSON",
}
ELSEWHERE = {
    "watch": "tests/end_to_end/cli/test_watch.py",
    "replay": "tests/end_to_end/service/test_recording_replay.py",
    "collect": "tests/end_to_end/cli/test_collect.py",
    "campaign from-table": "tests/lab/campaign/test_from_table.py",
    "daily-check": "tests/cli/test_daily_check.py",
    **dict.fromkeys(("fleet add", "fleet overview"), "tests/fleet/test_overview.py"),
    "fleet family": "tests/lab/identification/test_family.py",
    **dict.fromkeys(
        ("fleet identify", "fleet diagnose"), "tests/fleet/test_campaigns.py"
    ),
    "certify": "tests/cli/test_certify.py",
    "points verify": "tests/end_to_end/delivery/test_signed_points.py",
    "points resend": "tests/end_to_end/delivery/test_outbox_recovery.py",
    "microscribe arm-file": "tests/cli/devices/test_microscribe.py",
    **dict.fromkeys(("can scan", "can preset"), "tests/cli/devices/test_can.py"),
    **dict.fromkeys(
        (*("point", "undo", "scan", "label", "session", "reload"), "confirm", "home"),
        "tests/end_to_end/cli/test_control.py",
    ),
    **dict.fromkeys(("probe use", "send"), "tests/end_to_end/cli/test_control.py"),
    "joints": "tests/cli/test_joints.py",
    "board test": "tests/cli/devices/test_board.py",
    "extensions": "tests/test_extensions.py",
    "features": "tests/cli/test_features.py",
    **dict.fromkeys(
        ("amt21 scan", "amt21 zero", "amt21 reset"), "tests/cli/devices/test_amt21.py"
    ),
}
"""Commands that want a device or daemon, or take seconds: their tests read the JSON."""
ROBOT = """\
<robot name="one"><link name="base"/><link name="tip"/>
  <joint name="J1" type="revolute"><parent link="base"/><child link="tip"/>
    <origin xyz="0 0 0.2"/><axis xyz="0 0 1"/></joint>
</robot>
"""
DH = "name,a_mm,d_mm,alpha_rad\nJ1,0,200,1.5708\nJ2,300,0,0\n"
NOMINAL = "name,x_mm,y_mm,z_mm\nA,0,0,0\nB,800,0,0\nC,0,500,0\nD,0,0,90\n"


def commands() -> Iterator[tuple[str, Any]]:
    waiting = [("", typer.main.get_command(app))]
    while waiting:
        name, command = waiting.pop()
        if not hasattr(command, "commands"):
            yield name, command
            continue
        for word, below in command.commands.items():
            if not below.hidden:
                waiting.append((f"{name} {word}".strip(), below))


def has_json(command: Any) -> bool:
    return any("--json" in option.opts for option in command.params)


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small file of every kind that a command reads."""
    folder = tmp_path_factory.mktemp("desk")
    shutil.copy(CHECKOUT / "cli" / "demo_data" / "arm.toml", folder)
    arm = read_arm(folder / "arm.toml")
    spec = CampaignSpec(mix="cones+bar", n_poses=80)
    poses = make_poses(arm, spec, seed=3)
    write_campaign(folder / "campaign", draw_noise(poses, 5), arm)
    point = encode(POINT, "json")
    (folder / "points.jsonl").write_bytes(point + b"\n")
    (folder / "nominal.csv").write_text(NOMINAL)
    (folder / "touched.csv").write_text(NOMINAL)
    (folder / "table.csv").write_text(DH)
    (folder / "robot.urdf").write_text(ROBOT)
    store = MessageDatabase(folder / "outbox.db")
    store.add([message_of(POINT, "traverse/bench-7/point", "json", 10**18, "")])
    store.close()
    return folder


OFFICE = {
    "check": ["check arm.toml", "check campaign", "check table.csv"],
    "artefact": ["artefact --out gauge"],
    "arm show": ["arm show arm.toml"],
    "arm to-dh": ["arm to-dh arm.toml --postures 10 --out dh.csv"],
    "arm to-urdf": ["arm to-urdf arm.toml --postures 10 --out arm.urdf"],
    "arm to-qif": ["arm to-qif arm.toml --out arm.qif"],
    "arm from-dh": ["arm from-dh table.csv --convention classic --out of-dh.toml"],
    "arm from-urdf": ["arm from-urdf robot.urdf --out of-urdf.toml"],
    "identify": ["identify --compare arm.toml arm.toml"],
    "predict": ["predict campaign --arm arm.toml"],
    "diagnose": ["diagnose campaign --arm arm.toml --plan"],
    "verify": ["verify --plan iso10360-12 --arm arm.toml --out planned"],
    "trace": ["trace arm.toml"],
    "align": ["align touched.csv --nominal nominal.csv --std 0.01"],
    "probe pivot": ["probe pivot campaign --arm arm.toml --cone cone-1 --yes"],
    "export": ["export points.jsonl --to csv", "export points.jsonl --to dxf"],
    "points key": ["points key --out arm.key"],
    "points list": ["points list --db outbox.db"],
    "points export": ["points export --db outbox.db --out outbox.csv"],
}
REFUSED = {"check table.csv": 2}


def document_of(line: str, status: int = 0) -> Any:
    """Parse a command's output with `--json`: one document and no more."""
    ran = invoke(*line.split(), "--json", status=status)
    return json.loads(ran.stdout)


@pytest.mark.parametrize("line", [line for lines in OFFICE.values() for line in lines])
def test_a_command_on_files_prints_one_document(
    line: str, desk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(desk)
    assert document_of(line, REFUSED.get(line, 0))


def test_points_of_an_outbox_are_a_document_a_line(desk: Path) -> None:
    line = f"points list --db {desk / 'outbox.db'} --session {POINT.session} --json"
    ran = invoke(*line.split())
    assert [json.loads(row)["seq"] for row in ran.stdout.splitlines()] == [POINT.seq]


@pytest.mark.needs("mosquitto")
async def test_a_recording_is_reported_in_one_document(
    mosquitto: Mosquitto, tmp_path: Path
) -> None:
    name = f"arm-{uuid.uuid4().hex[:8]}"
    async with VirtualDaemon(name, mosquitto.host, mosquitto.port).running():
        where = ("--arm-name", name, "--broker", f"{mosquitto.host}:{mosquitto.port}")
        words = ("record", "a", *where, "--seconds", "0.1", "--json")
        with Program(tmp_path, "record", *words) as recording:
            assert await recording.ended() == 0
            assert json.loads(recording.output) == RECORDED
            assert "recording a.mcap" in recording.log


def test_every_command_is_seen_to_print_json_or_it_is_told_why_not() -> None:
    seen = {*OFFICE, *ELSEWHERE, "record"}
    every = dict(commands())
    assert {name for name, command in every.items() if has_json(command)} == seen
    assert set(every) - seen == set(WITHOUT)


@pytest.mark.parametrize(("command", "test"), ELSEWHERE.items())
def test_what_is_seen_elsewhere_is_read_there_as_json(command: str, test: str) -> None:
    text = (CHECKOUT / test).read_text("utf-8")
    assert '"--json"' in text, (command, test)
    assert f'"{command.rsplit(maxsplit=1)[-1]}"' in text, (command, test)
