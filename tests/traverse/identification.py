"""Running `traverse identify` as a program."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

END_S = 60.0


def run_identify(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run it in a folder, its output piped; warnings are errors."""
    return subprocess.run(
        [sys.executable, "-W", "error", "-m", "traverse", "identify", *arguments],
        capture_output=True,
        text=True,
        timeout=END_S,
        check=False,
        cwd=folder,
        env={**os.environ, "COLUMNS": "200"},
    )


def said_json(ran: subprocess.CompletedProcess[str]) -> Any:
    """What it said as JSON, after it went well."""
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)
