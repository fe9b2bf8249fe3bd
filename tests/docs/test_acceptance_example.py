import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import CHECKOUT, text_of
from tests.docs.telling import assert_printed, blocks, output_of
from tests.lab.acceptance.stated import state_all, write_numbered

PAGE = "docs/acceptance.md"
_VERIFY = re.compile(r"`(traverse verify example [^`]*)`")


@pytest.mark.slow
def test_the_arm_is_judged_as_told(tmp_path: Path) -> None:
    program, limits = (next(iter(blocks(PAGE, kind))) for kind in ("python", "toml"))
    lacking, complete, *_ = blocks(PAGE, "text")
    arm = CHECKOUT / "cli" / "demo_data" / "arm.toml"
    program = program.replace("cli/demo_data/arm.toml", str(arm))
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True)
    (tmp_path / "limits.toml").write_text(limits, "utf-8")
    command = _VERIFY.search(text_of(PAGE))
    assert command is not None
    # Nothing is decided, then neither accepted nor rejected: exit status 1.
    printed = output_of(command[1], tmp_path, status=1)
    assert_printed(printed, lacking.splitlines(), command[1])
    remainder = re.search(r"and (\d+) more \[statements\]", text_of(PAGE))
    assert remainder is not None
    assert printed.count("Missing: ") == 3 + int(remainder[1])
    state_all(tmp_path / "example")
    write_numbered(arm, tmp_path / "example" / "arm.toml")
    form = "measuring_range_mm = 2400.0\n[mpe]", "[standards]\nform_mm = 0.0006\n"
    text = limits.replace("[mpe]", form[0]) + form[1]
    (tmp_path / "limits.toml").write_text(text, "utf-8")
    printed = output_of(command[1], tmp_path, status=1)
    assert_printed(printed, complete.splitlines(), command[1])
