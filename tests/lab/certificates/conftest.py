"""Results to certify: a verification and an identification, made once."""

import shutil
from pathlib import Path

import pytest

from tests.lab.certificates.made import ARM, LABORATORY, Issued, issued
from tests.running import invoke
from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.certificates.certificate import certify
from traverse.lab.certificates.evidence import add_data
from traverse.lab.certificates.signature import SigningKey
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

LIMITS = """\
schema = "traverse/acceptance-limits/1"
[mpe]
interim_length_mm = 0.050
"""


def _dated(campaign: Path) -> None:
    text = campaign.read_text("utf-8")
    head = 'operator = "M. Curie"\nplace = "Room 2"\nstart_utc = 2026-11-20T09:00:00Z\n'
    campaign.write_text(text.replace("[noise]", f"{head}[noise]", 1), "utf-8")


@pytest.fixture(scope="session")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("laboratory") / "laboratory.toml"
    path.write_text(LABORATORY, "utf-8")
    return path


@pytest.fixture(scope="session")
def signer() -> Issued:
    return issued("Laboratory 2026")


@pytest.fixture(scope="session")
def verified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as `traverse verify` leaves it."""
    folder = tmp_path_factory.mktemp("verified")
    arm = read_arm(ARM)
    poses = drawn_acceptance(acceptance_poses(arm, "vdi2617-9", 3), 3)
    write_campaign(folder / "campaign", poses, arm)
    _dated(folder / "campaign" / "campaign.toml")
    (folder / "limits.toml").write_text(LIMITS)
    arguments = ("--standard", "vdi2617-9", "--arm", ARM, "--limits")
    out = folder / "results"
    invoke(
        *("verify", folder / "campaign", *arguments, folder / "limits.toml"),
        *("--out", out),
    )
    return out


@pytest.fixture(scope="session")
def identified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as `traverse identify` leaves it, with its raw data."""
    folder = tmp_path_factory.mktemp("identified")
    arm = read_arm(ARM)
    poses = make_poses(arm, CampaignSpec(mix="cones+bar", n_poses=120), seed=3)
    write_campaign(folder / "campaign", draw_noise(poses, 5), arm)
    _dated(folder / "campaign" / "campaign.toml")
    out = folder / "results"
    invoke("identify", folder / "campaign", "--arm", ARM, "--out", out)
    add_data(out, folder / "campaign", ARM)
    return out


def _signed(results: Path, folder: Path, laboratory: Path, signer: Issued) -> Path:
    copy = shutil.copytree(results, folder / "results")
    certify(copy, laboratory, SigningKey(signer.key, signer.certificate))
    return copy


@pytest.fixture(scope="session")
def signed_verification(
    verified: Path,
    laboratory: Path,
    signer: Issued,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    return _signed(verified, tmp_path_factory.mktemp("signed"), laboratory, signer)


@pytest.fixture(scope="session")
def signed_identification(
    identified: Path,
    laboratory: Path,
    signer: Issued,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    return _signed(identified, tmp_path_factory.mktemp("signed"), laboratory, signer)
