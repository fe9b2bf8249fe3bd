"""`python3 -m tests.vm.system.removal`: purges the package; finds remains of it.

For the Python of the system, because the package's is removed.
"""

import asyncio
import os
import subprocess
import sys
from pathlib import Path

from tests.vm.table import Table

BEFORE = Path("/run/before")
PACKAGES = ("traverse-fleet", "traverse-lab", "traverse")
# Written by others meanwhile: the package manager, systemd, the broker, this Python.
OTHERS = (
    "/var/cache/ldconfig",
    "/var/lib/dpkg",
    "/var/lib/mosquitto",
    "/var/lib/systemd",
    "/var/log",
    "/var/tmp",
    "/tmp",
    "/etc/passwd-",
    "/etc/shadow-",
    "/etc/group-",
    "/etc/gshadow-",
    "/etc/.pwd.lock",
    "/run",
)


def done(*words: str) -> str:
    """Return a program's output; it must succeed."""
    ran = subprocess.run(words, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, f"{words[0]}: {ran.returncode}, {ran.stderr}"
    return ran.stdout


def remove() -> str:
    """Removal keeps the configuration and the points."""
    done("dpkg", "--remove", *PACKAGES)
    state = sorted(p.name for p in Path("/var/lib/traverse/bench-7").iterdir())
    assert "outbox.db" in state, state
    assert Path("/etc/traverse/bench-7/arm.toml").exists()
    assert not Path("/usr/lib/traverse").exists()
    running = subprocess.run(["pgrep", "-x", "traverse"], check=False).returncode
    assert running == 1, "a daemon runs on"
    return f"daemon ended; configuration and {len(state)} files of state are kept"


def purge() -> str:
    """Purging leaves nothing."""
    done("dpkg", "--purge", *PACKAGES)
    before = set(BEFORE.read_text("utf-8").splitlines())
    prune = ["(", "-path", "/tmp", "-o", "-path", "/var/log", ")", "-prune", "-o"]
    after = set(done("find", "/", "-xdev", *prune, "-print").splitlines())
    left = sorted(p for p in after - before if not p.startswith(OTHERS))
    assert not left, f"{len(left)} files, such as {left[:5]}"
    lost = sorted(p for p in before - after if not p.startswith(OTHERS))
    assert not lost, f"{len(lost)} files are gone, such as {lost[:5]}"
    for kind in ("passwd", "group"):
        answer = subprocess.run(["getent", kind, "traverse"], check=False)
        assert answer.returncode == 2, f"{kind} has traverse"
    units = done("systemctl", "list-units", "--all", "--no-legend", "traverse*")
    assert not units.strip(), units
    return f"of {len(before)} files none more and none less; no user, no unit"


def uptime_s() -> float:
    return float(Path("/proc/uptime").read_text("ascii").split()[0])


async def run(folder: Path) -> int:
    table = Table(folder / "table.jsonl")
    await table.check("dpkg --remove", remove)
    await table.check("dpkg --purge", purge)
    report = f"{table}\n{uptime_s():.0f} s in the guest\n"
    (folder / "table.txt").write_text(report, "utf-8")
    return table.n_failed


if __name__ == "__main__":
    sys.exit(min(1, asyncio.run(run(Path(os.environ["TRAVERSE_VM_OUT"])))))
