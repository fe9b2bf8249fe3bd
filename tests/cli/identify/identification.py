import json
import subprocess
from pathlib import Path
from typing import Any

from tests.running import run_traverse


def run_identify(
    folder: Path, *arguments: str, status: int | None = 0
) -> subprocess.CompletedProcess[str]:
    """Run it in a folder, its output piped; warnings are errors."""
    return run_traverse(folder, "identify", *arguments, status=status)


def said_json(ran: subprocess.CompletedProcess[str]) -> Any:
    return json.loads(ran.stdout)
