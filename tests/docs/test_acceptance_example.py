"""The worked example of the acceptance test does what its page says."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import CHECKOUT, text_of
from tests.docs.telling import assert_printed, blocks, output_of

PAGE = "docs/acceptance.md"
_VERIFY = re.compile(r"`(traverse verify example [^`]*)`")


@pytest.mark.slow
def test_the_arm_is_judged_as_told(tmp_path: Path) -> None:
    program, limits, said = (
        next(iter(blocks(PAGE, kind))) for kind in ("python", "toml", "text")
    )
    arm = CHECKOUT / "cli" / "demo_data" / "arm.toml"
    program = program.replace("cli/demo_data/arm.toml", str(arm))
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True)
    (tmp_path / "limits.toml").write_text(limits, "utf-8")
    command = _VERIFY.search(text_of(PAGE))
    assert command is not None
    # Neither accepted nor rejected: exit status 1.
    printed = output_of(command[1], tmp_path, status=1)
    assert_printed(printed, said.splitlines(), command[1])
