"""Install the packages of a lock file, then Traverse, into a virtual environment.

Usage: PYTHON deploy/environment.py LOCK EXTRAS

Run by `make venv` and `make demo` with the interpreter of that environment. Shows how
many packages are there and how many are left, since a first installation downloads
megabytes. Needs nothing but pip.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from pip._vendor.packaging.requirements import InvalidRequirement, Requirement

PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install"]
# Python compiles what it imports, once; most modules of most packages never are.
PIP += ["--no-compile"]
FAILED = 1


def wanted(lock: Path) -> list[str]:
    """Read the names in a lock file that are meant for this machine.

    Raises:
        ValueError: a line is no requirement.
    """
    names = []
    for number, line in enumerate(lock.read_text("utf-8").splitlines(), 1):
        text = line.partition("#")[0].strip()
        if not text:
            continue
        try:
            requirement = Requirement(text)
        except InvalidRequirement as error:
            raise ValueError(f"{lock}:{number}: {error}; run `make lock`") from error
        if requirement.marker is None or requirement.marker.evaluate():
            names.append(requirement.name)
    return names


def install(lock: Path, count: int) -> None:
    """Install what the lock file names, with progress.

    Raises:
        subprocess.CalledProcessError: pip failed, and has said why.
    """
    command = [*PIP, "--no-deps", "--progress-bar", "off", "--requirement", str(lock)]
    with tempfile.TemporaryFile("w+") as errors:
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=errors, text=True
        ) as pip:
            assert pip.stdout is not None  # noqa: S101 - it is a pipe
            for line in progress(pip.stdout, count):
                show(line)
        if pip.returncode:  # else they are warnings about where pip has looked
            errors.seek(0)
            print(f"\n{errors.read()}", file=sys.stderr)  # noqa: T201 - this is a program
            raise subprocess.CalledProcessError(pip.returncode, command)


def progress(lines: Iterator[str], count: int) -> Iterator[str]:
    """Tell of each package as pip takes it up, of the last step, and of errors."""
    done = 0
    for line in lines:
        words = line.split()
        match words:
            case ["Collecting" | "Processing", source, *_]:
                done += 1
                name = re.split("[-=]=?[0-9]", source.rpartition("/")[2])[0]
                yield f"  {done} of {count} packages, {count - done} left: {name}"
            case ["Requirement", "already", *_]:
                done += 1
            case ["Installing", "collected", *_]:
                yield f"  unpacking {done} packages"


def show(text: str) -> None:
    """Write a line: over the last one on a terminal, below it elsewhere."""
    if sys.stdout.isatty():
        print(f"\r\033[K{text}", end="", flush=True)  # noqa: T201 - as above
    elif text:
        print(text, flush=True)  # noqa: T201 - as above


def main() -> int:
    """Install; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("lock", type=Path)
    parser.add_argument("extras", help="names, separated by commas")
    options = parser.parse_args()
    lock, extras = options.lock, options.extras
    try:
        names = wanted(lock)
        show(f"Python packages: {len(names)} of {lock.name}")
        install(lock, len(names))
        show("Traverse itself")
        subprocess.run(
            [*PIP, "--quiet", "--no-deps", "--editable", f".[{extras}]"], check=True
        )
    except (ValueError, OSError, subprocess.CalledProcessError) as error:
        print(f"environment.py: {error}", file=sys.stderr)  # noqa: T201 - as above
        return FAILED
    if sys.stdout.isatty():
        show("")
    return 0


if __name__ == "__main__":
    sys.exit(main())
