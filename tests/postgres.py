"""A real PostgreSQL on loopback, started, stopped and killed by tests."""

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path

from tests.mosquitto import HOST, free_port

START_S = 20.0
# Debian has the server's programs where users do not look, one folder a version.
PROGRAMS = "usr/lib/postgresql/*/bin/postgres"


class Postgres:
    """A server with a port of its own, kept over stops.

    It refuses to run as root: a root's test has it run as the user of Debian's package.
    """

    def __init__(self) -> None:
        self.port = free_port()
        (*_, program) = sorted(Path("/").glob(PROGRAMS))
        self._programs = program.parent
        self._user = "postgres" if os.getuid() == 0 else None
        self.folder = Path(tempfile.mkdtemp(prefix="postgres-"))
        if self._user is not None:
            shutil.chown(self.folder, self._user, self._user)
        self._data = self.folder / "data"
        self._process: subprocess.Popen[bytes] | None = None
        self._run("initdb", "-D", self._data, "-A", "trust", "-U", "postgres")
        self.start()

    @property
    def url(self) -> str:
        return self._url("fleet")

    def new_database(self, name: str) -> str:
        command = f"CREATE DATABASE {name}"
        self._run("psql", "-q", "-c", command, self._url("postgres"))
        return self._url(name)

    def _url(self, name: str) -> str:
        return f"postgresql://postgres@{HOST}:{self.port}/{name}"

    def start(self) -> None:
        with (self.folder / "log").open("ab") as log:
            self._process = subprocess.Popen(
                [
                    *(self._programs / "postgres", "-D", self._data),
                    *("-p", str(self.port), "-k", self.folder, "-h", HOST),
                ],
                **self._as_user(),
                stdout=log,
                stderr=log,
            )
        until_s = time.monotonic() + START_S
        is_ready = [
            self._programs / "pg_isready",
            "-q",
            "-h",
            HOST,
            "-p",
            str(self.port),
        ]
        while subprocess.run(is_ready, check=False).returncode:
            if self._process.poll() is not None or time.monotonic() > until_s:
                log_end = (self.folder / "log").read_text()[-2000:]
                raise AssertionError(f"PostgreSQL did not start: {log_end}")
            time.sleep(0.05)

    def kill(self) -> None:
        """End it as a power cut would, with all its processes."""
        if self._process is None:
            return
        # Its children end when their parent is gone; that takes a moment.
        children = _children(self._process.pid)
        self._process.kill()
        self._process.wait()
        for pid in children:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self._process = None

    def close(self) -> None:
        self.kill()
        shutil.rmtree(self.folder)

    def _as_user(self) -> dict[str, object]:
        if self._user is None:
            return {}
        return {"user": self._user, "group": self._user, "extra_groups": []}

    def _run(self, program: str, *words: object) -> None:
        subprocess.run(
            [self._programs / program, *map(str, words)],
            **self._as_user(),
            check=True,
            capture_output=True,
            cwd="/",
        )


def _children(pid: int) -> list[int]:
    path = Path(f"/proc/{pid}/task/{pid}/children")
    return list(map(int, path.read_text().split()))
