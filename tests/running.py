"""Running `traverse` and other programs to their end, with the status expected."""

import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from click.testing import Result
from typer.testing import CliRunner

from tests.warm_start import warm_start
from traverse.cli.__main__ import app

END_S = 120.0


def invoke(*words: object, status: int | None = 0, **options: Any) -> Result:
    """Run `traverse` in this process; None: any exit status."""
    ran = CliRunner().invoke(app, [str(word) for word in words], **options)
    assert status in (None, ran.exit_code), (ran.output, ran.exception)
    return ran


def run_traverse(
    folder: Path, *arguments: str, status: int | None = 0
) -> subprocess.CompletedProcess[str]:
    """Run it in a folder, its output no terminal; warnings are errors."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        process = warm_start().start(
            arguments, folder, {**os.environ, "COLUMNS": "200"}, stdout=out, stderr=err
        )
        try:
            ended = process.wait(END_S)
        finally:
            process.kill()
            process.wait(END_S)
        out.seek(0)
        err.seek(0)
        ran = subprocess.CompletedProcess(arguments, ended, out.read(), err.read())
    assert status in (None, ended), ran
    return ran


def run_program(
    *words: object, status: int | None = 0, **options: Any
) -> subprocess.CompletedProcess[str]:
    ran = subprocess.run(
        [str(word) for word in words],
        capture_output=True,
        text=True,
        timeout=END_S,
        check=False,
        **options,
    )
    assert status in (None, ran.returncode), ran
    return ran
