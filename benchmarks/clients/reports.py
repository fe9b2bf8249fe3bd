"""`python -m benchmarks.clients.reports FOLDER`: pictures of reports for docs/.

A simulated test by ISO 10360-12 with the data of a laboratory, and an identification
from benchmarks.tools.command_line import run_main
from cones alone, by the commands of a user: the first page of the certificate's PDF as
PDFium draws it, and the top of the identification's report in Chromium.
"""

import contextlib
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
from traverse.simulator.campaigns import write_campaign
from traverse.simulator.campaigns.acceptance.poses import (
    acceptance_poses,
    drawn_acceptance,
)

CHECKOUT = Path(__file__).parent.parent.parent
TUTORIAL = CHECKOUT / "docs" / "tutorial" / "identify-an-arm.md"
ADDED = """\
start_utc = 2026-11-20T09:00:00Z
operator = "M. Example"
place = "Measuring room 2"
[noise]"""
SPHERE = 'serial_number = "KS-25-0815"\ncalibration_date = 2026-05-04\n'
BAR = 'serial_number = "L-1700-12"\ncalibration_date = 2026-05-06\n'
LIMITS = """\
schema = "traverse/acceptance-limits/1"
[mpe]
p_size_mm = 0.012
p_form_mm = 0.030
l_dia_mm = 0.045
e_uni_mm = 0.0245
[standards]
form_mm = 0.0006
form_std_mm = 0.0001
"""
COLOURS = 256


def traverse(*arguments: str) -> None:
    """Run a command; exit status 1 is a verdict."""
    command = [sys.executable, "-m", "traverse", *arguments, "--operator", "M. Example"]
    if subprocess.run(command, check=False, stdout=subprocess.DEVNULL).returncode > 1:
        raise SystemExit(f"{command} failed")


def certificate(out: Path) -> None:
    """The first page of a certificate that is neither accepted nor rejected."""
    arm = read_arm(CHECKOUT / "cli" / "demo_data" / "arm.toml")
    write_arm(Path("arm.toml"), arm.model_copy(update={"serial_number": "D7-0042"}))
    drawn = drawn_acceptance(acceptance_poses(arm, "iso10360-12", seed=1), seed=1)
    write_campaign(Path("acceptance"), drawn, arm)
    file = Path("acceptance/campaign.toml")
    text = file.read_text("utf-8").replace("[noise]", ADDED, 1)
    for kind, lines in (("sphere", SPHERE), ("points", BAR)):
        text = text.replace(f'kind = "{kind}"\n', f'kind = "{kind}"\n{lines}')
    file.write_text(text, "utf-8")
    Path("limits.toml").write_text(LIMITS, "utf-8")
    traverse(
        *("verify", "acceptance", "--standard", "iso10360-12", "--arm", "arm.toml"),
        *("--limits", "limits.toml", "--out", "certificate"),
    )
    with pypdfium2.PdfDocument("certificate/certificate.pdf") as document:
        small(document[0].render(scale=1.4).to_pil(), out / "certificate.png")


def identification(out: Path) -> None:
    """The report of the tutorial's identification without a length."""
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
    """Make all pictures, in a folder."""
    out = folder.resolve()
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary, contextlib.chdir(temporary):
        certificate(out)
        identification(out)


if __name__ == "__main__":
    run_main(main)
