"""Running `traverse identify` as a program."""

import json
import subprocess
from pathlib import Path
from typing import Any

from tests.cli.programs import run_traverse


def run_identify(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run it in a folder, its output piped; warnings are errors."""
    return run_traverse(folder, "identify", *arguments)


def said_json(ran: subprocess.CompletedProcess[str]) -> Any:
    """Its JSON output, after success."""
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)
