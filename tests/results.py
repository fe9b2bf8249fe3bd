"""Campaigns of the demonstration's arm and results of them, made once in a session.

Nobody writes into these folders: a test that alters something makes a copy.
"""

import shutil
from pathlib import Path

from tests.lab.acceptance.stated import limits_text, state_all, write_numbered
from tests.running import run_traverse
from tests.shared import new_folder, shared
from traverse.kinematics.arm_file.arm import read_arm
from traverse.simulator.campaigns import (
    CampaignSpec,
    draw_noise,
    make_poses,
    write_campaign,
)
from traverse.simulator.campaigns.acceptance.poses import (
    acceptance_poses,
    drawn_acceptance,
)

ARM = Path(__file__).parents[1] / "cli" / "demo_data" / "arm.toml"
WHEN = 'operator = "M. Curie"\nplace = "Room 2"\nstart_utc = 2026-11-20T09:00:00Z\n'


def write_simulated(folder: Path, mix: str, n_poses: int) -> None:
    arm = read_arm(ARM)
    poses = make_poses(arm, CampaignSpec(mix=mix, n_poses=n_poses), seed=3)
    write_campaign(folder / "campaign", draw_noise(poses, 5), arm)
    _date(folder / "campaign")
    shutil.copy(ARM, folder / "arm.toml")


def _date(campaign: Path) -> None:
    file = campaign / "campaign.toml"
    text = file.read_text("utf-8")
    file.write_text(text.replace("[noise]", f"{WHEN}[noise]", 1), "utf-8")


@shared
def measured() -> Path:
    """A campaign that determines everything, and the arm file."""
    folder = new_folder()
    write_simulated(folder, "cones+bar", 160)
    return folder


@shared
def identified() -> Path:
    """The same with results in `out`, and the output in `said` and `errors`."""
    folder = shutil.copytree(measured(), new_folder(), dirs_exist_ok=True)
    words = ("identify", "campaign", "--arm", "arm.toml", "--out", "out")
    ran = run_traverse(folder, *words)
    (folder / "said").write_text(ran.stdout, "utf-8")
    (folder / "errors").write_text(ran.stderr, "utf-8")
    return folder


@shared
def verified() -> Path:
    """A stated acceptance `campaign`, `limits.toml`, and files of verify in `out`."""
    folder, arm = new_folder(), read_arm(ARM)
    poses = drawn_acceptance(acceptance_poses(arm, "vdi2617-9", 3), 3)
    write_campaign(folder / "campaign", poses, arm)
    state_all(folder / "campaign")
    write_numbered(ARM, folder / "arm.toml")
    (folder / "limits.toml").write_text(limits_text(interim_length_mm=0.05))
    words = ("--standard", "vdi2617-9", "--arm", "arm.toml", "--limits", "limits.toml")
    run_traverse(folder, "verify", "campaign", *words, "--out", "out")
    return folder
