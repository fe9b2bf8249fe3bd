"""From an Arduino to a calibrated arm, with commands from the page itself."""

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.docs.pages import CHECKOUT
from tests.docs.telling import assert_printed, blocks, output_of, printed_blocks
from tests.running import run_program
from traverse.kinematics.arm_file.arm import read_arm

PAGE = "docs/tutorial/arduino-to-calibrated-arm.md"


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_an_arm_of_a_board_is_calibrated_as_told(tmp_path: Path) -> None:
    daemon, magnet, bench = blocks(PAGE, "toml")
    (tmp_path / "traverse.toml").write_text(daemon, "utf-8")
    (tmp_path / "magnet.toml").write_text(magnet, "utf-8")
    (tmp_path / "bench.toml").write_text(bench, "utf-8")
    table = next(text for text in blocks(PAGE, "text") if text.startswith("name,"))
    (tmp_path / "arm.csv").write_text(table, "utf-8")
    for command, shown in printed_blocks(PAGE):
        if "simulate campaign" in command:
            joining = "cat design.toml magnet.toml > built.toml"
            assert f"$ {joining}" in (CHECKOUT / PAGE).read_text("utf-8")
            subprocess.run(["/bin/sh", "-c", joining], cwd=tmp_path, check=True)
        assert_printed(output_of(command, tmp_path), shown, command)
    # The configuration fits the designed arm and the calibrated one.
    assert "valid" in output_of("traverse check traverse.toml", tmp_path)
    shutil.copy(tmp_path / "diagnosed" / "arm.cov.npz", tmp_path)
    shutil.copy(tmp_path / "diagnosed" / "arm.toml", tmp_path / "design.toml")
    assert "valid" in output_of("traverse check traverse.toml", tmp_path)
    (effect,) = read_arm(tmp_path / "design.toml").effects
    assert (effect.kind, effect.joint) == ("encoder_eccentricity", "J2")
    # `collect` begins with the gauge's first socket; nobody listens at that port.
    words = "collect gauge --arm design.toml --each 25 --broker 127.0.0.1:9"
    ran = run_program(
        *(sys.executable, "-m", "traverse", *words.split()),
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        status=3,
    )
    assert "Touch gauge-1 1 (seats): 25 more" in ran.stdout
    hidden = tomllib.loads(magnet)["effects"][0]
    assert abs(effect.values["cos_rad"] - hidden["cos_rad"]) < 0.002
    assert abs(effect.values["sin_rad"] - hidden["sin_rad"]) < 0.002
