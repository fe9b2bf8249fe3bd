"""Running `traverse` as a program."""

import os
import subprocess
import sys
from pathlib import Path

END_S = 120.0


def run_traverse(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run it in a folder, its output piped; warnings are errors."""
    return subprocess.run(
        [sys.executable, "-W", "error", "-m", "traverse", *arguments],
        capture_output=True,
        text=True,
        timeout=END_S,
        check=False,
        cwd=folder,
        env={**os.environ, "COLUMNS": "200"},
    )
