"""Install the packages of a lock file, then Traverse, into a virtual environment.

Usage: PYTHON deploy/environment.py LOCK EXTRAS

Run by `make venv` and `make demo` with the interpreter of that environment. uv installs
with this machine's settings of pip: in a seventh of its time, most of which pip looks
through indexes. Where uv cannot, pip does. Needs nothing but pip.
"""

import argparse
import ast
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from pip._vendor.packaging.requirements import InvalidRequirement, Requirement

# The lock file that names the version of uv, among all others.
LOCK = Path(__file__).resolve().parents[1] / "requirements.lock"
PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
# Python compiles what it imports, once; most modules of most packages never are.
PIP_INSTALL = [*PIP, "install", "--no-compile", "--no-deps", "--quiet"]
UV_INSTALL = [sys.executable, "-m", "uv", "pip", "install", "--no-deps"]
# The kernel is built anew: uv would take an editable package as it was.
UV_INSTALL += ["--python", sys.executable, "--reinstall-package", "traverse-cmm"]
# Settings of pip, and the environment variables that are the same to uv.
UV_NAMES = {
    "index-url": "UV_DEFAULT_INDEX",
    "extra-index-url": "UV_EXTRA_INDEX_URL",
    "find-links": "UV_FIND_LINKS",
    "trusted-host": "UV_INSECURE_HOST",
    "cert": "SSL_CERT_FILE",
    "proxy": "ALL_PROXY",
}
FAILED = 1


def required_packages(lock: Path) -> list[str]:
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


def uv_settings(listed: str) -> dict[str, str]:
    """Return uv's variables for the settings that `pip config list` prints."""
    # As pip does: the best version of all indexes.
    settings = {"UV_INDEX_STRATEGY": "unsafe-best-match"}
    for line in listed.splitlines():
        name, _, value = line.partition("=")
        variable = UV_NAMES.get(name.rpartition(".")[2])
        if variable is not None:
            words = str(ast.literal_eval(value)).split()
            settings[variable] = ("," if variable == "UV_FIND_LINKS" else " ").join(
                words
            )
    return settings


def environment_of_uv() -> Mapping[str, str] | None:
    command = [*PIP_INSTALL, "--constraint", str(LOCK), "uv"]
    if subprocess.run(command, check=False).returncode:
        return None
    listed = subprocess.run(
        [*PIP, "config", "list"], capture_output=True, text=True, check=True
    )
    return {**uv_settings(listed.stdout), **os.environ}


def install(arguments: list[str], uv: Mapping[str, str] | None) -> None:
    """Install by uv, else by pip.

    Raises:
        subprocess.CalledProcessError: pip failed, and has said why.
    """
    if uv is not None:
        if not subprocess.run(
            [*UV_INSTALL, *arguments], env=uv, check=False
        ).returncode:
            return
        say("uv cannot; pip tries")
    subprocess.run([*PIP_INSTALL, *arguments], check=True)


def say(text: str) -> None:
    """Print a line now, before the next command's output."""
    print(text, flush=True)  # noqa: T201 - this is a program


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("lock", type=Path)
    parser.add_argument("extras", help="names, separated by commas")
    options = parser.parse_args()
    lock, extras = options.lock, options.extras
    try:
        say(f"Python packages: {len(required_packages(lock))} of {lock.name}")
        uv = environment_of_uv()
        install(["--requirement", str(lock)], uv)
        say("Traverse itself")
        install(["--editable", f".[{extras}]"], uv)
    except (ValueError, OSError, subprocess.CalledProcessError) as error:
        print(f"environment.py: {error}", file=sys.stderr)  # noqa: T201 - as above
        return FAILED
    return 0


if __name__ == "__main__":
    sys.exit(main())
