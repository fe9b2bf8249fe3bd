"""Identify the arm of `traverse demo` by a simulated campaign.

python -m benchmarks.tools.identify_demo_arm

Makes a campaign of the very arm that the demonstration simulates, its deviations and
seed taken from `cli/demo_data/simulator.toml`, has `traverse identify` identify it, and
puts the arm file and its covariance beside the simulator's file.
"""

import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import traverse.cli
from benchmarks.tools.command_line import run_main

DATA = Path(traverse.cli.__file__).parent / "demo_data"
SPECIFICATION = """\
schema = "traverse/simulated-campaign/1"
arm = "arm.toml"
mix = "cones+bar"
n_poses = 300
[deviations]
links_mm = {links_mm}
axes_rad = {axes_rad}
zeros_rad = 0.0
"""


def main() -> None:
    simulator = tomllib.loads((DATA / "simulator.toml").read_text("utf-8"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copy(DATA / "arm.toml", folder)
        text = SPECIFICATION.format(**simulator["arm"]["deviations"])
        (folder / "bench.toml").write_text(text, "utf-8")
        seed = str(simulator["seed"])
        words = ("simulate", "campaign", "bench.toml", "--out", "campaign")
        _run(folder, "-m", "traverse", *words, "--seed", seed)
        identified = ("identify", "campaign", "--arm", "arm.toml", "--out", "result")
        _run(folder, "-m", "traverse", *identified)
        shutil.copy(folder / "result" / "arm.toml", DATA / "identified.toml")
        shutil.copy(folder / "result" / "arm.cov.npz", DATA)


def _run(folder: Path, *words: str) -> None:
    subprocess.run([sys.executable, *words], cwd=folder, check=True)


if __name__ == "__main__":
    run_main(main)
