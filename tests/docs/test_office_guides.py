"""Guides that need no arm: every command of theirs, and what they show of it."""

import re
from pathlib import Path

import pytest

from tests.docs.accounts import why_not_run
from tests.docs.pages import CHECKOUT, commands, text_of
from tests.docs.shell import Shell, as_run
from tests.docs.telling import assert_printed, told

ARM_FILES = "docs/how-to/arm-file-from-dh-or-urdf.md"
SECURE = "docs/how-to/secure-the-broker.md"
ROBOT = """\
<robot name="robot">
  <link name="base"/> <link name="upper"/> <link name="tool0"/>
  <joint name="J1" type="revolute">
    <parent link="base"/> <child link="upper"/>
    <origin xyz="0 0 0.2"/> <axis xyz="0 0 1"/>
  </joint>
  <joint name="J2" type="continuous">
    <parent link="upper"/> <child link="tool0"/>
    <origin xyz="0.3 0 0"/> <axis xyz="0 1 0"/>
  </joint>
</robot>
"""


@pytest.mark.slow
async def test_arm_files_are_made_and_shown_as_told(tmp_path: Path) -> None:
    table = re.search(r"^```text\n(name,.*?)^```$", text_of(ARM_FILES), re.M | re.S)
    assert table is not None
    (tmp_path / "ur10.csv").write_text(table[1], "utf-8")
    (tmp_path / "robot.urdf").write_text(ROBOT, "utf-8")
    for line, shown in told(ARM_FILES):
        with Shell(tmp_path, "shown", as_run(line, 0)) as shell:
            printed = await shell.ends()
        assert_printed(printed, [one for one in shown if one != "..."], line)
    assert (tmp_path / "table.toml").exists()


@pytest.mark.slow
@pytest.mark.needs("openssl")
async def test_certificates_are_made_as_told(tmp_path: Path) -> None:
    lines = [line for line in commands(SECURE) if line.startswith(("openssl", "echo"))]
    assert len(lines) == 6
    for line in lines:
        assert why_not_run(line) is None
        # The page's authority has a passphrase, which is asked for.
        unasked = line.replace("req -x509", "req -x509 -noenc")
        with Shell(tmp_path, "made", unasked) as shell:
            await shell.ends()
    verify = "openssl verify -CAfile authority.crt broker.crt"
    with Shell(tmp_path, "verified", verify) as shell:
        assert await shell.ends() == "broker.crt: OK\n"


def test_the_files_that_the_guide_copies_are_there() -> None:
    copied = [line.split()[1] for line in commands(SECURE) if line.startswith("cp ")]
    assert copied
    assert all((CHECKOUT / path).exists() for path in copied)
