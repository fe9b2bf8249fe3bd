"""Run the README's commands in a pristine Debian, as a stranger's machine would.

Usage: python3 deploy/fresh_machine.py [SUITE] [--python PACKAGE] [--or-in-place]
           [--then COMMAND]...

The tree holds Debian's minimal base, git, make, Python and certificates, and nothing of
this machine but where it gets packages from: its Debian mirror, its settings of pip and
npm, its certificate authorities, and what earlier runs have downloaded. It is made once
by mmdebstrap and kept in build/fresh; each run unpacks it anew, clones the commit that
is checked out, runs the commands as they stand in the README, and prints what each
took. Needs root. Exit status 2: no tree can be made here, and it says why; 1: a command
failed.
"""

import argparse
import configparser
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
FOLDER = CHECKOUT / "build" / "fresh"
BUNDLE = Path("/etc/ssl/certs/ca-certificates.crt")
PACKAGES = ("git", "make", "ca-certificates")
# Downloads, kept for the next run: name below build/fresh, and place.
CACHES = {
    "apt": "/var/cache/apt/archives",
    "pip": f"{Path.home()}/.cache/pip",
    "uv": f"{Path.home()}/.cache/uv",
}
# The tree, some 4 GB, is in memory where the tests keep as much again.
MEMORY_BYTES = 10 << 30
# Environment variables that are settings of pip, npm and the network.
SETTINGS = re.compile("(?i)(pip|npm_config|uv)_.*|.*_proxy|.*_ca_certs|.*_cert(_file)?")
# Processes, terminals and devices of its own, then the command.
INSIDE = (CHECKOUT / "deploy" / "fresh_machine.sh.template").read_text("utf-8")
CLONE = "/srv/traverse"
FAILED, NOT_HERE = 1, 2


class NotHereError(Exception):
    """No tree can be made on this machine."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("suite", nargs="?", default="bookworm", help="of Debian")
    parser.add_argument("--python", default="python3", help="Debian's package of it")
    parser.add_argument(
        "--or-in-place",
        action="store_true",
        help="where no tree can be made, run the commands in this checkout",
    )
    parser.add_argument(
        "--then",
        action="append",
        default=[],
        metavar="COMMAND",
        help="a command after those of the README; repeatable",
    )
    options = parser.parse_args()
    commands = readme_commands() + options.then
    if options.python != "python3":
        commands = [f"{command} PYTHON={options.python}" for command in commands]
    try:
        with unpacked(made_tree(options.suite, options.python)) as tree:
            clone(tree)
            done, took = timed(commands, lambda words: run(tree, words, CLONE))
    except (NotHereError, OSError, subprocess.CalledProcessError) as error:
        say(f"fresh_machine.py: {error}")
        if not options.or_in_place:
            return NOT_HERE
        done, took = timed(commands, run_in_place)
        say(f"Not on a fresh machine, but in this checkout: {took}\n({error})")
        return 0 if done else FAILED
    say(f"On a pristine Debian {options.suite}, {options.python}: {took}")
    return 0 if done else FAILED


def clone(tree: Path) -> None:
    """Clone the commit that is checked out.

    Raises:
        NotHereError: nothing can be run in the tree.
    """
    if run(tree, f"git clone --quiet /mnt/checkout {CLONE}", "/"):
        raise NotHereError("nothing can be run in the tree; see above")


def run_in_place(command: str) -> int:
    return subprocess.run(["sh", "-c", command], cwd=CHECKOUT, check=False).returncode


def timed(commands: list[str], execute: Callable[[str], int]) -> tuple[bool, str]:
    """Run commands until one fails; return whether none did, and their durations."""
    took = []
    for command in commands:
        say(f"--- {command}")
        begun_s = time.monotonic()
        status = execute(command)
        failed = f" (FAILED with exit status {status})" if status else ""
        took.append(f"{command}: {time.monotonic() - begun_s:.0f} s{failed}")
        if status:
            break
    return not status, "; ".join(took)


def say(text: str) -> None:
    """Print a line now, before the next command's output."""
    print(text, flush=True)  # noqa: T201 - this is a program


def readme_commands() -> list[str]:
    text = (CHECKOUT / "README.md").read_text("utf-8")
    block = text.partition("```console\n")[2].partition("```")[0]
    lines = [line for line in block.splitlines() if line.startswith("$ make ")]
    return [line.removeprefix("$ ").partition("#")[0].strip() for line in lines]


def made_tree(suite: str, python: str) -> Path:
    """Make the archive of a tree, unless it is there.

    Raises:
        NotHereError: no root, no mmdebstrap, or no packages.
    """
    archive = FOLDER / f"{suite}-{python}.tar"
    if os.geteuid():
        raise NotHereError("unpacking a Debian needs root; run it as root")
    if shutil.which("mmdebstrap") is None:
        raise NotHereError("no mmdebstrap; install it with: apt-get install mmdebstrap")
    if archive.exists():
        return archive
    FOLDER.mkdir(parents=True, exist_ok=True)
    part = archive.with_suffix(".part.tar")
    say(f"Making a tree of Debian {suite}, once, about a minute: {archive.name}")
    include = ",".join((*PACKAGES, python))
    command = ["mmdebstrap", "--quiet", "--mode=root", "--variant=minbase"]
    package_sources = sources(suite)
    command += [*apt_settings(), f"--include={include}", suite, str(part), "-"]
    result = subprocess.run(command, input=package_sources, text=True, check=False)
    if result.returncode:
        raise NotHereError(f"mmdebstrap cannot make Debian {suite}; see above")
    part.rename(archive)
    return archive


def sources(suite: str) -> str:
    """Write where this machine gets Debian's packages from, for a suite.

    Raises:
        NotHereError: this machine is no Debian.
    """
    form = "$(REPO_URI) $(CODENAME) $(LABEL)"
    command = ["apt-get", "indextargets", "--format", form]
    command += ["Created-By: Packages", "Origin: Debian", "Component: main"]
    try:
        ran = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise NotHereError(
            f"where Debian's packages are is not known: {error}"
        ) from None
    rows = sorted({tuple(line.split(" ", 2)) for line in ran.stdout.splitlines()})
    if not rows:
        raise NotHereError("no lists of packages here; run: apt-get update")
    if any(codename == suite for _, codename, _ in rows):
        return "".join(f"deb {uri} {codename} main\n" for uri, codename, _ in rows)
    mirrors = {uri for uri, _, label in rows if label == "Debian"}
    return "".join(f"deb {uri} {suite} main\n" for uri in sorted(mirrors))


def apt_settings() -> list[str]:
    """Read how this machine's apt gets at its mirror: proxies, dates, authorities."""
    ran = subprocess.run(
        ["apt-config", "dump", "Acquire"], capture_output=True, text=True, check=True
    )
    return [
        f"--aptopt={line}"
        for line in ran.stdout.splitlines()
        if re.match("Acquire::(Check|https?::(Proxy|CA))", line)
    ]


@contextmanager
def unpacked(archive: Path) -> Iterator[Path]:
    """Unpack a tree with this machine's settings; it is gone after the block."""
    tree = FOLDER / "tree"
    remove(tree)
    tree.mkdir()
    if available_bytes() > MEMORY_BYTES:
        memory = ["mount", "--types", "tmpfs", "--options", "size=90%", "tmpfs", tree]
        subprocess.run(memory, check=False)  # else it is on the disk
    subprocess.run(["tar", "-xf", archive, "-C", tree], check=True)
    # Debian's installer writes them; mmdebstrap copies the names of this machine's.
    (tree / "etc/hostname").write_text("fresh\n")
    (tree / "etc/hosts").write_text("127.0.0.1 localhost fresh\n::1 localhost\n")
    # It is gone afterwards: nothing has to survive a power cut.
    (tree / "etc/dpkg/dpkg.cfg.d").mkdir(parents=True, exist_ok=True)
    (tree / "etc/dpkg/dpkg.cfg.d/fresh").write_text("force-unsafe-io\n")
    try:
        with ExitStack() as mounts:
            for path in settings_files():
                mounts.enter_context(mounted(path, tree))
            mounts.enter_context(mounted(CHECKOUT, tree, "/mnt/checkout"))
            for name, place in CACHES.items():
                kept = FOLDER / "downloads" / name
                (kept / "partial").mkdir(parents=True, exist_ok=True)  # apt wants it
                mounts.enter_context(mounted(kept, tree, place, options="rw"))
            yield tree
    finally:
        remove(tree)


def available_bytes() -> int:
    lines = Path("/proc/meminfo").read_text("utf-8").splitlines()
    fields = dict(line.split(":", 1) for line in lines)
    return int(fields["MemAvailable"].split()[0]) * 1024


def remove(tree: Path) -> None:
    """Remove a tree, and nothing through a mount that an earlier run left."""
    points = [line.split()[1] for line in Path("/proc/mounts").read_text().splitlines()]
    inside = (p for p in points if p == str(tree) or p.startswith(f"{tree}/"))
    for point in sorted(inside, reverse=True):
        subprocess.run(["umount", "--lazy", point], check=True)
    if tree.exists():
        shutil.rmtree(tree)


@contextmanager
def mounted(
    path: Path, tree: Path, mount_point: str | None = None, options: str = "ro"
) -> Iterator[None]:
    """Show a file or folder of this machine in a tree, to be read only by default.

    Raises:
        NotHereError: mounting is not allowed.
    """
    place = tree / (mount_point or str(path)).lstrip("/")
    place.parent.mkdir(parents=True, exist_ok=True)
    if path.is_dir():
        place.mkdir(parents=True, exist_ok=True)
    else:
        place.touch()
    mount = ["mount", "--bind", "--options", options, path, place]
    if subprocess.run(mount, check=False).returncode:
        raise NotHereError("folders cannot be mounted here; see above")
    try:
        yield
    finally:
        subprocess.run(["umount", place], check=True)


def settings_files() -> set[Path]:
    """Find settings of pip and npm, certificates, and the folders that they name."""
    files = {Path(f) for f in ("/etc/pip.conf", "/etc/xdg/pip", "/etc/npmrc")}
    home = Path.home()
    files |= {home / name for name in (".config/pip", ".pip", ".npmrc")} | {BUNDLE}
    files = {path for path in files if path.exists()}
    texts = [value for name, value in os.environ.items() if SETTINGS.fullmatch(name)]
    for path in [
        f for f in (Path("/etc/pip.conf"), home / ".config/pip/pip.conf") if f.exists()
    ]:
        parser = configparser.ConfigParser()
        parser.read(path)
        texts += [value for section in parser.values() for value in section.values()]
    for text in texts:
        for word in re.findall(r"(?:(?<=\s)|^|(?<=file://))/\S+", text):
            # An index is a folder of files that its pages may name beside it.
            path = Path(word)
            if path.name == "simple":
                path = path.parent
            if path.exists():
                files.add(path)
    inside = [f for f in files if any(parent in f.parents for parent in files)]
    return files - set(inside)


def run(tree: Path, command: str, folder: str) -> int:
    """Run a command in a tree: with processes, terminals and mounts of its own."""
    script = INSIDE.format(folder=folder, command=command)
    isolation = [
        "unshare",
        "--mount",
        "--pid",
        "--fork",
        "--kill-child",
        "--uts",
        "--ipc",
    ]
    environment = {
        "HOME": str(Path.home()),
        "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
        "UV_LINK_MODE": "copy",  # its downloads are kept on another file system
        **{n: v for n, v in os.environ.items() if SETTINGS.fullmatch(n)},
    }
    ran = subprocess.run(
        [*isolation, "chroot", tree, "/bin/sh", "-c", script],
        env=environment,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    return ran.returncode


if __name__ == "__main__":
    sys.exit(main())
