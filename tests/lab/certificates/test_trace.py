"""`traverse trace`: chains that are whole, altered, missing or not stated."""

import json
import random
import re
import shutil
from pathlib import Path

import pytest

from tests.lab.certificates.test_tampering import mutated
from tests.protocol.message_examples import POINT
from tests.results import ARM
from tests.running import invoke
from traverse.kinematics.arm_file.arm import arm_digest, read_arm, write_arm
from traverse.lab.certificates.trace import Tracer
from traverse.lab.report.provenance import SUMS, read_sums
from traverse.protocol.encoding import encode
from traverse.recording.run_writer import Entry, RunHead, RunWriter
from traverse.strict_toml.problems import FileError


@pytest.fixture
def chain(identified: Path, verified: Path, tmp_path: Path) -> Path:
    """Beside each other: a design, what identified it, results, a verification."""
    measured = identified.parent / "campaign"
    shutil.copytree(measured, tmp_path / "campaign", ignore=lambda *_: ["arm.toml"])
    shutil.copytree(identified, tmp_path / "results")
    shutil.rmtree(tmp_path / "results" / "data")
    shutil.copytree(verified, tmp_path / "certificate")
    shutil.copy(ARM, tmp_path / "design.toml")
    return tmp_path


def states(path: Path, *folders: Path) -> dict[str, str]:
    """Every link of a chain with its state; names without what varies."""
    chain = Tracer([path.parent, *folders]).trace(path)
    return {re.sub(r" \(.*", "", link.what): link.state for link in chain.every()}


def test_a_whole_chain(chain: Path) -> None:
    by_name = states(chain / "results")
    assert by_name == {
        "identification": "whole",
        "arm file demo-7": "whole",
        "arm.cov.npz": "whole",
        "campaign": "whole",
        "arm file": "not stated",  # an old campaign
    }
    file = chain / "campaign" / "campaign.toml"
    digest = arm_digest(read_arm(ARM))
    text = file.read_text().replace("[noise]", f'arm_digest = "{digest}"\n[noise]', 1)
    file.write_text(text)
    assert states(chain / "campaign") == {
        "campaign": "whole",
        "arm file demo-7": "whole",
    }
    assert states(chain / "certificate")["poses.csv"] == "whole"


@pytest.mark.parametrize(
    ("gone", "link"),
    [
        ("campaign", "campaign"),
        ("design.toml", "design"),
        ("results/arm.cov.npz", "arm.cov.npz"),
    ],
)
def test_what_is_missing_is_named(chain: Path, gone: str, link: str) -> None:
    moved = chain.parent / f"{chain.name}-moved"
    moved.mkdir()
    shutil.move(chain / gone, moved / Path(gone).name)
    # The verification has the design, too.
    shutil.rmtree(chain / "certificate")
    path = chain / "results" / "arm.toml"
    assert states(path, chain)[link] == "missing"
    assert "missing" not in states(path, chain, moved).values()


def test_altered_bytes_of_any_file_break_the_chain(chain: Path) -> None:
    chance = random.Random(9)
    folder = chain / "certificate"
    for name in [*(read_sums(folder) or {}), SUMS]:
        path = folder / name
        original = path.read_bytes()
        for _ in range(20):
            changed = mutated(original, chance)
            path.write_bytes(changed)
            try:
                link_states = set(states(folder).values())
            except FileError:
                continue
            assert changed == original or link_states & {"altered", "missing"}, (
                name,
                changed,
            )
        path.write_bytes(original)
    assert not set(states(folder).values()) & {"altered", "missing"}


def test_another_arm_under_the_same_name_is_missing(chain: Path) -> None:
    shutil.rmtree(chain / "certificate")
    arm = read_arm(chain / "design.toml")
    write_arm(chain / "design.toml", arm.model_copy(update={"serial_number": "X"}))
    link_states = states(chain / "results" / "arm.toml", chain)
    assert link_states["design"] == "missing"


def test_a_recording_and_points_lead_to_the_arm(chain: Path) -> None:
    arm, recording = read_arm(ARM), chain / "run.mcap"
    head = RunHead({"joints": "[]"}, {"arm.toml": ARM.read_bytes()})
    with RunWriter(recording, head) as writer:
        for number in range(100):
            writer.add(Entry("pose", number, b"x" * 100))
    assert states(recording) == {"recording": "whole", "arm file demo-7": "whole"}
    content = recording.read_bytes()
    recording.write_bytes(content[: len(content) // 2])
    assert states(recording)["recording"] == "altered"
    points = chain / "points.jsonl"
    point = encode(POINT.model_copy(update={"model": arm_digest(arm)}), "json").decode()
    points.write_text(f"{point}\n")
    assert states(points) == {"points": "whole", "arm file demo-7": "whole"}
    other = encode(POINT, "json").decode()
    points.write_text(f"{other}\nno point\n")
    assert states(points) == {"points": "altered", "arm file": "missing"}


def test_the_command(chain: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(chain)
    ran = invoke("trace", "results")
    assert ran.output.splitlines()[0] == "identification (results): whole"
    assert ran.output.splitlines()[-1] == "1 not stated"
    shutil.move("campaign", chain.parent / f"{chain.name}-campaign")
    ran = invoke("trace", "results", "--json", status=1)
    values = json.loads(ran.output)
    assert values["state"] == "whole"
    (missing,) = [
        value for value in values["links"][0]["links"] if value["state"] == "missing"
    ]
    assert missing["what"] == "campaign"
    ran = invoke("trace", "results", "--in", chain.parent / f"{chain.name}-campaign")
    ran = invoke("trace", "nothing.txt", status=2)
    assert "is neither a folder of results" in ran.output
