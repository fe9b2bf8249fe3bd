import shutil
from pathlib import Path

import pytest

from tests.docs.pages import CHECKOUT
from tests.docs.telling import assert_printed, blocks, output_of, printed_blocks

PAGE = "docs/tutorial/a-detective-story.md"
# Their results are bad, as the page says.
BAD = (
    "traverse identify monday --arm design.toml",
    "traverse identify tuesday --arm identified/arm.toml",
    "traverse diagnose untold",
)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_detective_story_happens_as_told(tmp_path: Path) -> None:
    design = CHECKOUT / "cli" / "demo_data" / "arm.toml"
    shutil.copy(design, tmp_path / "design.toml")
    culprits, monday, tuesday = blocks(PAGE, "toml")
    suspect = design.read_text("utf-8") + "\n" + culprits
    (tmp_path / "suspect.toml").write_text(suspect, "utf-8")
    (tmp_path / "monday.toml").write_text(monday, "utf-8")
    (tmp_path / "tuesday.toml").write_text(tuesday, "utf-8")
    for command, shown in printed_blocks(PAGE):
        printed = output_of(command, tmp_path, int(command.startswith(BAD)))
        assert_printed(printed, shown, command)
    for name in ("conditions", "joints", "term-1", "term-2", "ledger"):
        assert (tmp_path / "found" / f"{name}.png").exists()
