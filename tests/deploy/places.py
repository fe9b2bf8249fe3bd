"""Where the files of an installation are, and programs that judge them."""

import os
import shutil
import subprocess
from pathlib import Path

DEPLOY = Path(__file__).parents[2] / "deploy"


def program(name: str) -> str:
    """Return its path; the test's `needs` marker has made sure of it."""
    path_of_program = shutil.which(name)
    assert path_of_program is not None, f"no {name} in {os.environ['PATH']}"
    return path_of_program


def output_of(*words: str | Path) -> str:
    """Output of a program, on both streams; it must succeed."""
    done = subprocess.run(
        words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
    return done.stdout
