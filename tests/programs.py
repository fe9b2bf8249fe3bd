"""Programs that are not part of every Debian: a test names the group that it needs.

`deploy/debian-packages.sh` is the one list of groups, their programs and the packages
that bring them. A test finds in its PATH what every Debian has, git, make, and the
programs of the groups in its `needs` marker, no others: a need that is not stated fails
on each machine, not only where the program happens to be missing.
"""

import os
import shutil
import subprocess
from functools import cache
from pathlib import Path

CHECKOUT = Path(__file__).parents[1]
INSTALLER = CHECKOUT / "deploy" / "debian-packages.sh"
BESIDE_ESSENTIAL = ("git", "make")
# Debian keeps programs of services where ordinary users do not look.
EVERYWHERE = f"{os.environ['PATH']}:/usr/sbin:/sbin"


@cache
def groups() -> dict[str, list[str]]:
    ran = subprocess.run(
        ["sh", str(INSTALLER), "--list"], capture_output=True, text=True, check=True
    )
    rows = [line.split("|") for line in ran.stdout.splitlines()]
    return {
        name: [program for program in needed.split() if ":" not in program]
        for name, needed, _ in rows
    }


def find(program: str) -> str | None:
    return shutil.which(program, path=EVERYWHERE)


def missing(group: str) -> list[str]:
    return [name for name in groups()[group] if find(name) is None]


def search_path(needed: frozenset[str], folder: Path) -> str:
    """Make a PATH with the programs of every Debian and of the groups.

    Args:
        needed: names of groups.
        folder: for the links to the programs.
    """
    base = _linked(folder, "base", _base_programs())
    if base is None:  # not a Debian: the base system is unknown
        return EVERYWHERE
    paths = {g: [p for n in groups()[g] if (p := find(n))] for g in sorted(needed)}
    return ":".join(
        [base, *(str(_linked(folder, group, paths[group])) for group in paths)]
    )


@cache
def _base_programs() -> tuple[str, ...]:
    if (query := find("dpkg-query")) is None:
        return ()
    form = "${Essential} ${Priority} ${Package}\n"
    ran = subprocess.run(
        [query, "-W", "-f", form], capture_output=True, text=True, check=True
    )
    fields = [line.split() for line in ran.stdout.splitlines()]
    names = [f[-1] for f in fields if f[0] == "yes" or "required" in f]
    ran = subprocess.run([query, "-L", *names], capture_output=True, text=True)  # noqa: PLW1510 - a name may be of several architectures
    files = {line for line in ran.stdout.splitlines() if "bin/" in line}
    paths = [find(name) for name in BESIDE_ESSENTIAL]
    # What has alternatives (awk, which) is a link that no package lists.
    paths += [find(name) for name in ("awk", "which")]
    return (*sorted(files), *(path for path in paths if path))


def _linked(
    folder: Path, name: str, programs: list[str] | tuple[str, ...]
) -> str | None:
    place = folder / name
    if not programs and name == "base":
        return None
    if not place.is_dir():
        place.mkdir(parents=True)
        for program in programs:
            link = place / Path(program).name
            if not link.exists() and os.access(program, os.X_OK):
                link.symlink_to(program)
    return str(place)
