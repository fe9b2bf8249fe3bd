import json
import re
import shlex
import subprocess
from pathlib import Path

import pytest
from typer.testing import Result

from tests.docs.pages import CHECKOUT
from tests.lab.acceptance.stated import limits_text, state_all, write_numbered
from tests.running import invoke
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

pytestmark = pytest.mark.needs("openssl")
ARM = CHECKOUT / "cli" / "demo_data" / "arm.toml"
PAGE = (CHECKOUT / "docs" / "how-to" / "sign-a-certificate.md").read_text("utf-8")


def run(line: str, status: int = 0) -> Result:
    return invoke(*shlex.split(line), status=status)


def shown(beginning: str) -> list[str]:
    return re.findall(rf"^\$ ({beginning}.*)$", PAGE, re.MULTILINE)


def write_dated(folder: Path, poses: object, arm: object) -> None:
    write_campaign(folder, poses, arm)
    file = folder / "campaign.toml"
    start = "start_utc = 2026-11-20T09:00:00Z\n[noise]"
    file.write_text(file.read_text().replace("[noise]", start, 1))


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with results as the page has them, a laboratory, and its key."""
    folder, arm = tmp_path_factory.mktemp("desk"), read_arm(ARM)
    touched = drawn_acceptance(acceptance_poses(arm, "vdi2617-9", 3), 3)
    write_campaign(folder / "acceptance", touched, arm)
    state_all(folder / "acceptance")
    poses = make_poses(arm, CampaignSpec(mix="cones+bar", n_poses=120), seed=3)
    write_dated(folder / "campaign", draw_noise(poses, 5), arm)
    write_numbered(ARM, folder / "design.toml")
    (folder / "limits.toml").write_text(limits_text(interim_length_mm=0.05))
    (laboratory,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    (folder / "laboratory.toml").write_text(laboratory)
    (openssl,) = shown("openssl")
    subprocess.run(shlex.split(openssl), cwd=folder, check=True, capture_output=True)
    return folder


@pytest.fixture
def at_desk(desk: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(desk)
    return desk


@pytest.mark.slow
def test_results_are_signed_and_checked_as_the_page_says(at_desk: Path) -> None:
    run(
        "verify acceptance --standard vdi2617-9 --arm design.toml "
        "--limits limits.toml --out certificate"
    )
    run("identify campaign --arm design.toml --out result")
    for line in shown("traverse certify"):
        output = run(line.removeprefix("traverse ")).output
        assert "dcc.xml: signed\nevery figure was computed again" in output
    (check,) = shown("traverse verify --check")
    for line in (check, check.replace("certificate ", "result ", 1)):
        output = run(line.removeprefix("traverse ")).output
        assert "digests agree, and the figures follow from the data" in output
        assert "O=Example Laboratory" in output
        assert "who is trusted" in output
    values = json.loads(run("verify --check result --json").output)
    assert values["problems"] == []
    assert any("was not compared" in note for note in values["notes"])
    page = at_desk / "certificate" / "certificate.html"
    page.write_text(page.read_text() + " ")
    printed = run("verify --check certificate --trust laboratory.pem", 1).output
    assert "certificate.html was altered" in printed


def test_wishes_that_do_not_go_together_are_refused(at_desk: Path) -> None:
    run("verify acceptance --standard vdi2617-9 --arm design.toml --out unlimited", 1)
    base = "certify unlimited --laboratory laboratory.toml"
    for options, message in (
        ("--key laboratory.key", "--key and --certificate belong together"),
        ("--campaign campaign", "--campaign and --arm belong together"),
        ("--key laboratory.pem --certificate laboratory.pem", "is no private key"),
        ("--key laboratory.key --certificate laboratory.key", "is no X.509"),
        ("--schemas acceptance", "is no schema that can be used"),
    ):
        assert message in run(f"{base} {options}", 2).output
    message = run("verify --check unlimited --trust laboratory.pem", 2).output
    assert "has no dcc.xml; `traverse certify` signs" in message
    message = run("certify acceptance --laboratory laboratory.toml", 2).output
    assert "is no folder of `traverse verify --out`" in message
    message = run("certify unlimited --laboratory limits.toml", 2).output
    assert "limits.toml" in message
    words = ["certify", *shlex.split(base)[1:], "--json"]
    values = json.loads(invoke(*words).output)
    assert (values["signed"], values["certificate"]) == (False, "unlimited/dcc.xml")
    note = run("verify --check unlimited").output
    assert "is not signed: who made it is not proved" in note


def test_a_key_with_a_password(at_desk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run("verify acceptance --standard vdi2617-9 --arm design.toml --out locked", 1)
    subprocess.run(
        shlex.split("openssl pkey -aes256 -passout pass:k -in laboratory.key -out k"),
        check=True,
        capture_output=True,
    )
    line = (
        "certify locked --laboratory laboratory.toml --key k "
        "--certificate laboratory.pem"
    )
    assert "TRAVERSE_KEY_PASSWORD" in run(line, 2).output
    monkeypatch.setenv("TRAVERSE_KEY_PASSWORD", "k")
    assert "signed" in run(line).output


def test_the_laboratory_is_on_the_page_and_certifies_its_own_numbers(
    at_desk: Path,
) -> None:
    run(
        "verify acceptance --standard vdi2617-9 --arm design.toml --limits limits.toml "
        "--laboratory laboratory.toml --out numbered"
    )
    page = (at_desk / "numbered" / "certificate.html").read_text("utf-8")
    for text in (
        "Certificate of verification 2026-0417",
        "Messweg 1, Braunschweig, DE, accreditation D-K-00000-01-00",
        "Example Works, Lyon, FR",
        "demo-7, own make Demo 7",
        "C. Gauss, head of the laboratory",
    ):
        assert text in page
    assert "figures follow from the data" in run("verify --check numbered").output
    other = (at_desk / "laboratory.toml").read_text().replace("2026-0417", "2026-0418")
    (at_desk / "other.toml").write_text(other)
    refused = run("certify numbered --laboratory other.toml", 2).output
    assert "another laboratory, customer or number" in " ".join(refused.split())
    assert "dcc.xml" in run("certify numbered --laboratory laboratory.toml").output
    data = at_desk / "numbered" / "data" / "laboratory.toml"
    data.write_text(other)
    assert "laboratory.toml was altered" in run("verify --check numbered", 1).output
