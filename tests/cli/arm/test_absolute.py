import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from traverse.kinematics.arm_file.arm import read_arm

TABLE = "alpha_rad,a_mm,d_mm\n0,0,100\n1.57,200,0\n"


def made(tmp_path: Path, *words: str, answer: str | None = None) -> tuple[Path, str]:
    """The arm file of `from-dh`, and its output; answered at a terminal."""
    (tmp_path / "dh.csv").write_text(TABLE, "utf-8")
    out = tmp_path / "arm.toml"
    command = [sys.executable, "-m", "traverse", "arm", "from-dh", "dh.csv", *words]
    command += ["--out", str(out), "--convention", "modified"]
    command += ["--counts-per-turn", "8192"]
    ours, theirs = pty.openpty()
    try:
        if answer is not None:
            os.write(ours, f"{answer}\n".encode())
        ended = subprocess.run(
            command,
            cwd=tmp_path,
            stdin=subprocess.DEVNULL if answer is None else theirs,
            capture_output=True,
            text=True,
            check=True,
        )
    finally:
        os.close(ours)
        os.close(theirs)
    return out, ended.stderr


@pytest.mark.parametrize(("answer", "absolute"), [("y", True), ("n", False)])
def test_at_a_terminal_it_is_asked(tmp_path, answer, absolute):
    out, output = made(tmp_path, answer=answer)
    assert "do they count right again after a loss of power?" in output
    encoders = [joint.encoder for joint in read_arm(out).joints]
    assert [encoder.absolute for encoder in encoders] == [absolute, absolute]


def test_elsewhere_it_is_warned_of_unless_it_is_stated(tmp_path):
    out, output = made(tmp_path)
    assert "say --absolute or --incremental" in output
    assert read_arm(out).joints[0].encoder.absolute is None
    out, output = made(tmp_path, "--incremental", "--force")
    assert output == ""
    assert read_arm(out).joints[0].encoder.absolute is False
