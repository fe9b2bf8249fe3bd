import tomllib
from pathlib import Path

import pytest

from tests.simulator.conftest import seven_text
from traverse.simulator.campaigns import CampaignFile
from traverse.simulator.campaigns.__main__ import main
from traverse.simulator.campaigns.command import campaign_made
from traverse.simulator.campaigns.spec import spec_problems
from traverse.strict_toml.reader import parse_strict

FILE = """
schema = "traverse/simulated-campaign/1"
arm = "arm.toml"
mix = "cones+bar"
n_poses = 30
"""


@pytest.fixture
def spec_file(tmp_path):
    (tmp_path / "arm.toml").write_text(seven_text())
    path = tmp_path / "spec.toml"
    path.write_text(FILE)
    return path


def run(path, seed=None):
    return campaign_made(path, path.parent / "out", seed)


def test_the_module_makes_a_campaign_and_says_what(spec_file, capsys, monkeypatch):
    out = str(spec_file.parent / "out")
    words = ["campaigns", str(spec_file), "--out", out, "--seed", "4"]
    monkeypatch.setattr("sys.argv", words)
    assert main() == 0
    output = capsys.readouterr().out
    assert "seed 4" in output
    assert "poses 30" in output
    assert "bar (ball_bar)" in output
    lines = (spec_file.parent / "out" / "poses.csv").read_text().splitlines()
    assert len(lines) == 1 + 30


def test_the_seed_decides_every_byte(spec_file):
    def poses(seed):
        assert run(spec_file, seed) == 0
        return (spec_file.parent / "out" / "poses.csv").read_bytes()

    first = poses(1)
    assert poses(2) != first
    assert poses(1) == first


def test_a_file_of_artefacts_is_read(spec_file):
    spec_file.write_text(
        """
schema = "traverse/simulated-campaign/1"
arm = "arm.toml"
seed = 3
travel = "full"
[deviations]
links_mm = 1.0
[noise]
encoder_rad = 1e-6
blunder_kinds = ["label"]
[conditions]
columns = ["direction"]
[[artefacts]]
id = "b"
kind = "ball_bar"
n_poses = 12
radius_mm = 10
distance_mm = 250
"""
    )
    assert run(spec_file) == 0
    table = tomllib.loads((spec_file.parent / "out" / "campaign.toml").read_text())
    assert table["noise"]["encoder_rad"] == 1e-6
    assert table["artefacts"][0]["distance_mm"] == 250.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (FILE + "n_pose = 3", "unknown key 'n_pose'; did you mean 'n_poses'?"),
        (FILE.replace("cones+bar", "cone"), "unknown mix 'cone'; known: bars, cones"),
        (FILE.replace("n_poses = 30", ""), "say how many poses the mix has"),
        (FILE.replace('mix = "cones+bar"', ""), "neither is given; give one"),
        (FILE + '[[artefacts]]\nid="a"\nkind="cone"\nn_poses=1', "both are given"),
        (FILE + '[[artefacts]]\nid="a"\nkind="cube"\nn_poses=1', "unknown kind of art"),
        (FILE + "limits_rad = [[1, -1]]", "the first must be smaller"),
        (FILE + "limits_rad = [[-1, 1]]", "has 1 entry; the arm has 7 joints"),
        (FILE + "[noise]\nblunder_kinds = []", "is empty; name at least one kind"),
        (FILE + "[noise]\nencoders_rad = [-1e-6]", "-1e-06 is negative"),
        (FILE.replace('schema = "traverse/simulated-campaign/1"', ""), "schema"),
        (FILE.replace("arm.toml", "leg.toml"), "leg.toml"),
    ],
)
def test_a_mistake_in_the_file_is_reported(spec_file, capsys, text, expected):
    spec_file.write_text(text)
    assert run(spec_file) == 2
    assert expected in capsys.readouterr().err


def test_the_reference_page_shows_a_file_that_is_valid_and_its_defaults():
    page = Path(__file__).parents[3] / "docs" / "reference" / "simulated-campaigns.md"
    text = page.read_text(encoding="utf-8").split("```toml")[1].split("```")[0]
    shown = parse_strict(text, "page", CampaignFile, spec_problems)
    bare = parse_strict(FILE, "bare", CampaignFile, spec_problems)
    assert shown.model_dump(exclude={"n_poses"}) == bare.model_dump(exclude={"n_poses"})


def test_two_artefacts_of_one_name_are_refused(spec_file, capsys):
    cone = '[[artefacts]]\nid = "a"\nkind = "cone"\nn_poses = 1\n'
    head = FILE.replace('mix = "cones+bar"\nn_poses = 30\n', "")
    spec_file.write_text(head + cone + cone)
    assert run(spec_file) == 2
    assert "'a' is used 2 times" in capsys.readouterr().err


def test_what_cannot_be_reached_is_reported(spec_file, capsys):
    head = FILE.replace('mix = "cones+bar"\nn_poses = 30\n', "")
    spec_file.write_text(
        head
        + '[[artefacts]]\nid = "wall"\nkind = "plane"\nn_poses = 9\nsize_mm = 9000\n'
    )
    assert run(spec_file) == 2
    assert "plane 'wall'" in capsys.readouterr().err
    assert not (spec_file.parent / "out").exists()
