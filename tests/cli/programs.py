"""Running `traverse` as a program."""

import os
import subprocess
import tempfile
from pathlib import Path

from tests.warm_start import warm_start

END_S = 120.0


def run_traverse(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run it in a folder, its output no terminal; warnings are errors."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        process = warm_start("-W", "error").start(
            arguments, folder, {**os.environ, "COLUMNS": "200"}, stdout=out, stderr=err
        )
        try:
            status = process.wait(END_S)
        finally:
            process.kill()
            process.wait(END_S)
        out.seek(0)
        err.seek(0)
        return subprocess.CompletedProcess(arguments, status, out.read(), err.read())
