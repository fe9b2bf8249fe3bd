"""`python -m benchmarks.clients.reports FOLDER`: pictures of reports for docs/.

A simulated test by ISO 10360-12 with the statements of a laboratory, the same without
them, and an identification from cones alone, by the commands of a user: the first pages
of the certificates' PDF as PDFium draws them, and the top of the identification's
report in Chromium.
"""

import contextlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pypdfium2
from PIL import Image
from playwright.sync_api import sync_playwright

from benchmarks.tools.command_line import run_main
from traverse.kinematics.arm_file.arm import read_arm, write_arm
from traverse.lab.report.provenance import OPERATOR_VARIABLE
from traverse.simulator.campaigns import write_campaign
from traverse.simulator.campaigns.acceptance.poses import (
    acceptance_poses,
    drawn_acceptance,
)

CHECKOUT = Path(__file__).parent.parent.parent
TUTORIAL = CHECKOUT / "docs" / "tutorial" / "identify-an-arm.md"
SIGNING = CHECKOUT / "docs" / "how-to" / "sign-a-certificate.md"
STATED = """\
operator = "M. Example"
place = "Measuring room 2"
start_utc = 2026-11-20T09:00:00Z
[circumstances]
probe = "TP-6, ball 6 mm, No. 118"
humidity_percent = 44.0
pressure_hpa = 1009.0
warm_up_min = 90.0
"""
CERTIFICATE = """\
serial_number = "{number}"
certificate_number = "{certificate}"
calibrated_by = "Example Laboratory, D-K-00000-01-00"
calibration_date = 2026-05-04
valid_until = 2028-05-04
material = "{material}"
"""
STANDARDS = {
    "sphere": ("KS-25-0815", "4711", "zirconia"),
    "points": ("L-1700-12", "4712", "carbon-fibre"),
}
LIMITS = """\
schema = "traverse/acceptance-limits/1"
{statements}
[mpe]
p_size_mm = 0.012
p_form_mm = 0.030
l_dia_mm = 0.045
e_uni_mm = 0.035
[standards]
temperature_std_c = 0.1
temperature_degrees = 9
form_mm = 0.0006
form_std_mm = 0.0001
fixture_std_mm = 0.0003
"""
COLOURS = 256


def traverse(*arguments: str) -> None:
    """Run a command; exit status 1 is a verdict."""
    command = [sys.executable, "-m", "traverse", *arguments]
    environment = {**os.environ, OPERATOR_VARIABLE: "M. Example"}
    ran = subprocess.run(
        command, check=False, stdout=subprocess.DEVNULL, env=environment
    )
    if ran.returncode > 1:
        raise SystemExit(f"{command} failed")


def certificates(out: Path) -> None:
    """The first page of a certificate, and of figures that lack statements."""
    arm = read_arm(CHECKOUT / "cli" / "demo_data" / "arm.toml")
    drawn = drawn_acceptance(acceptance_poses(arm, "iso10360-12", seed=1), seed=1)
    write_campaign(Path("acceptance"), drawn, arm)
    write_arm(Path("arm.toml"), arm)
    Path("limits.toml").write_text(LIMITS.format(statements=""), "utf-8")
    verified("figures", out / "certificate-refused.png")
    write_arm(Path("arm.toml"), arm.model_copy(update={"serial_number": "D7-0042"}))
    file = Path("acceptance/campaign.toml")
    head, table, tail = file.read_text("utf-8").partition("\n[")
    text = f"{head}\n{STATED}{table[1:]}{tail}"
    for kind, (number, certificate, material) in STANDARDS.items():
        lines = CERTIFICATE.format(
            number=number, certificate=certificate, material=material
        )
        text = text.replace(f'kind = "{kind}"\n', f'kind = "{kind}"\n{lines}')
    file.write_text(text, "utf-8")
    statements = "measuring_range_mm = 2400.0\nnext_date = 2027-11-20"
    Path("limits.toml").write_text(LIMITS.format(statements=statements), "utf-8")
    laboratory = re.search(r"```toml\n(.*?)```", SIGNING.read_text("utf-8"), re.DOTALL)
    Path("laboratory.toml").write_text(laboratory[1] if laboratory else "", "utf-8")
    more = ("--laboratory", "laboratory.toml")
    verified("certificate", out / "certificate.png", *more)


def verified(folder: str, picture: Path, *more: str) -> None:
    traverse(
        *("verify", "acceptance", "--standard", "iso10360-12", "--arm", "arm.toml"),
        *("--limits", "limits.toml", "--out", folder),
        *more,
    )
    with pypdfium2.PdfDocument(f"{folder}/certificate.pdf") as document:
        small(document[0].render(scale=1.4).to_pil(), picture)


def identification(out: Path) -> None:
    text = TUTORIAL.read_text("utf-8")
    bench = next(re.finditer(r"```toml\n(.*?)```", text, re.DOTALL))[1]
    Path("bench.toml").write_text(bench, "utf-8")
    shutil.copy(CHECKOUT / "cli" / "demo_data" / "arm.toml", "design.toml")
    traverse("simulate", "campaign", "bench.toml", "--out", "cones", "--seed", "1")
    traverse("identify", "cones", "--arm", "design.toml", "--out", "result")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = chromium.new_page(viewport={"width": 1000, "height": 760})
        page.goto(Path("result/report.html").resolve().as_uri())
        page.screenshot(path="report.png")
        chromium.close()
    with Image.open("report.png") as picture:
        small(picture.convert("RGB"), out / "identification.png")


def small(picture: Image.Image, file: Path) -> None:
    picture.quantize(COLOURS).save(file, optimize=True)


def main(folder: Path) -> None:
    out = folder.resolve()
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary, contextlib.chdir(temporary):
        certificates(out)
        identification(out)


if __name__ == "__main__":
    run_main(main)
