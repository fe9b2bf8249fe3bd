"""From parts to a calibrated arm: its commands, on the firmware in an emulated Mega."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import CHECKOUT
from tests.docs.telling import blocks, output_of, printed_blocks
from tests.firmware.mega import MegaBoard, mega_firmware
from tests.running import run_traverse
from traverse.kinematics.arm_file.arm import read_arm

PAGE = "docs/tutorial/parts-to-calibrated-arm.md"
QUARTER = 1024
TURNS = [(0, 1), (2, 1), (1, 1), (3, -1), (4, 1), (5, 1)]  # channel, sense, by joint


@pytest.mark.slow
@pytest.mark.needs("compiler", "avr", "simavr")
def test_the_board_passes_and_its_encoders_are_found_as_told(tmp_path: Path) -> None:
    (daemon,) = blocks(PAGE, "toml")
    port = tmp_path / "port"
    daemon = daemon.replace("/dev/serial/by-id/usb-Arduino_Mega_2560-if00", str(port))
    (tmp_path / "traverse.toml").write_text(daemon, "utf-8")
    table = next(text for text in blocks(PAGE, "text") if text.startswith("name,"))
    (tmp_path / "arm.csv").write_text(table, "utf-8")
    shown = dict(printed_blocks(PAGE))
    (designed,) = (command for command in shown if "from-dh" in command)
    assert output_of(designed, tmp_path).splitlines() == shown[designed]

    settings = "FRONT_END=AS5600 CHANNELS=6 INPUTS=1"
    assert f"make -C firmware mega {settings}" in (CHECKOUT / PAGE).read_text("utf-8")
    options = ("--encoders", "as5600", "--channels", "6", "--bits", "12")
    with MegaBoard(port, mega_firmware(*settings.split()), *options) as board:
        ran = run_traverse(tmp_path, "board", "test", str(port))
        assert "fail" not in ran.stdout
        board.do(*(f"count {n} {700 * n}" for n in range(6)), "fail 5 1")
        process = subprocess.Popen(
            [sys.executable, "-m", "traverse", "joints", "traverse.toml"],
            cwd=tmp_path,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert process.stdin
        assert process.stdout
        printed = []
        waiting = list(TURNS)
        for line in process.stdout:
            printed.append(line)
            if "then Enter" in line:
                channel, sense = waiting.pop(0)
                count = (700 * channel + sense * QUARTER) % 4096
                board.do(f"count {channel} {count}")
                process.stdin.write("\n")
                process.stdin.flush()
        assert process.wait(20.0) == 0
        process.stdin.close()
        process.stdout.close()
    lines = "".join(printed).splitlines()
    assert lines == shown["traverse joints traverse.toml"]
    encoders = [joint.encoder for joint in read_arm(tmp_path / "design.toml").joints]
    assert [(e.channel, e.sign) for e in encoders if e] == TURNS
    shutil.copy(tmp_path / "design.toml", tmp_path / "arm.toml")
    assert "valid" in output_of("traverse check traverse.toml", tmp_path)
