"""The unit of the arm, as systemd and the kernel see it."""

import asyncio
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

ARM = "bench-7"
LOOK_S = 0.5
NAME = f"traverse@{ARM}.service"


def systemctl(*words: str) -> str:
    return run("systemctl", *words)


def run(*words: str) -> str:
    """Return a program's output; it must succeed."""
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    output = f"{done.stdout}{done.stderr}".strip()
    assert done.returncode == 0, f"{' '.join(words)}: {done.returncode}, {output}"
    return done.stdout.strip()


def shown(name: str) -> str:
    return systemctl("show", NAME, "--property", name, "--value")


def main_pid() -> int:
    """The daemon's process; 0: there is none."""
    return int(shown("MainPID"))


def processes() -> list[Path]:
    group = Path("/sys/fs/cgroup") / shown("ControlGroup").lstrip("/")
    pids = (group / "cgroup.procs").read_text("ascii").split()
    return [Path("/proc") / pid for pid in pids]


def status_of(process: Path) -> dict[str, str]:
    lines = (process / "status").read_text("utf-8").splitlines()
    pairs = (line.split(":", 1) for line in lines)
    return {name: value.strip() for name, value in pairs}


def journal() -> str:
    """Log of the daemon, and systemd's entries about it."""
    return run("journalctl", "--no-pager", "--output=cat", "--unit", NAME)


async def until(
    condition: Callable[[], object], awaited: str, timeout_s: float
) -> None:
    """Look now and then, because each look costs a program."""
    end_s = time.monotonic() + timeout_s
    while not await asyncio.to_thread(condition):
        assert time.monotonic() < end_s, f"not within {timeout_s:g} s: {awaited}"
        await asyncio.sleep(LOOK_S)
