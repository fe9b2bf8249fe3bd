"""Programs that start quickly: forked from a process that has imported their modules.

Imports are most of what a short program computes, and the tests start hundreds of them.
What runs is `python -m traverse` all the same: a process with its own main module,
arguments, folder, environment, files and session, and a child of the test. Tests of the
start itself, of terminals and of the commands on pages begin with a new interpreter.
"""

import ctypes
import gc
import importlib
import json
import math
import os
import runpy
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

# What a command imports when it runs.
MODULES = {
    "run": ("traverse.daemon.app",),
    "simulate": ("traverse.simulator.run",),
    "identify": (
        "traverse.lab.identification.identify",
        "traverse.lab.identification.report.page",
    ),
    "diagnose": (
        "traverse.lab.diagnosis.diagnose",
        "traverse.lab.diagnosis.report.files",
    ),
    "page": ("traverse.client.exports.formats", "traverse.client.page.server"),
    "watch": ("traverse.client.arm", "rich.live"),
}
PR_SET_CHILD_SUBREAPER = 36
LOOK_S = 0.005
MOST_BYTES = 1 << 16


class Process:
    """A child process, with what the tests use of `subprocess.Popen`."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Its exit status, None while it runs."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float = math.inf) -> int:
        """Wait for its end."""
        end_s = time.monotonic() + timeout
        while (status := self.poll()) is None:
            if time.monotonic() > end_s:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout)
            time.sleep(LOOK_S)
        return status

    def send_signal(self, number: int) -> None:
        """Send a signal unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)


class WarmStart:
    """The process that programs are forked from; one for all tests of a worker."""

    def __init__(self, *options: str) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._server = subprocess.Popen(
                [sys.executable, *options, __file__, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
            )
        self._socket = ours

    @property
    def pid(self) -> int:
        """Of the process, which is there after a test."""
        return self._server.pid

    def start(
        self,
        arguments: tuple[str, ...],
        folder: Path,
        environment: Mapping[str, str],
        *,
        stdout: IO[Any],
        stderr: IO[Any],
    ) -> Process:
        """Start `python -m traverse` with arguments, in a session of its own.

        Args:
            arguments: of the command line.
            folder: where it runs.
            environment: all of its variables.
            stdout, stderr: files of its output and errors; it has no input.
        """
        request = [list(arguments), str(folder), dict(environment)]
        files = [stdout.fileno(), stderr.fileno()]
        _adopt_orphans(True)
        try:
            socket.send_fds(self._socket, [json.dumps(request).encode()], files)
            answer = self._socket.recv(MOST_BYTES)
        finally:
            _adopt_orphans(False)
        assert answer, "the process that starts programs has ended"
        return Process(int(answer))

    def close(self) -> None:
        """End the process; programs go on."""
        self._socket.close()
        self._server.wait(20.0)


_started: dict[tuple[str, ...], WarmStart] = {}


def warm_start(*options: str) -> WarmStart:
    """Return the process for interpreter options, started on first use."""
    if options not in _started:
        _started[options] = WarmStart(*options)
    return _started[options]


def pids() -> set[int]:
    """Processes of this worker that programs are forked from."""
    return {server.pid for server in _started.values()}


def close_all() -> None:
    """End them."""
    while _started:
        _started.popitem()[1].close()


def _adopt_orphans(adopt: bool) -> None:
    """Become the parent of grandchildren whose parent ends, as init would."""
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, int(adopt), 0, 0, 0)


def _serve(connection: socket.socket) -> tuple[list[str], list[int]] | None:
    """Fork programs until the tests close the connection; None then.

    Returns in every program too, with its arguments and files.
    """
    while True:
        data, files, _, _ = socket.recv_fds(connection, MOST_BYTES, 2)
        if not data:
            return None
        arguments, folder, environment = json.loads(data)
        for name in MODULES.get(arguments[0], ()):
            importlib.import_module(name)
        gc.freeze()  # what is collected in a program at its end is its own
        reader, writer = os.pipe()
        if (between := os.fork()) == 0:
            if pid := os.fork():
                os.write(writer, str(pid).encode())
                os._exit(0)
            os.close(reader)
            os.close(writer)
            connection.close()
            os.setsid()
            os.chdir(folder)
            os.environ.clear()
            os.environ.update(environment)
            return arguments, files
        os.close(writer)
        for file in files:
            os.close(file)
        pid_text = os.read(reader, 32)
        os.close(reader)
        os.waitpid(between, 0)  # from now on the program is a child of the tests
        connection.sendall(pid_text)


def _main() -> None:
    sys.path.pop(0)  # the folder of this file
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    importlib.import_module("traverse.cli.__main__")
    with socket.socket(fileno=int(sys.argv[1])) as connection:
        program = _serve(connection)
    if program is None:
        return
    arguments, files = program
    for number, file in enumerate(files, start=1):
        os.dup2(file, number)
        os.close(file)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.path.insert(0, os.getcwd())
    sys.argv[1:] = arguments
    del sys.modules["traverse.cli.__main__"]
    runpy.run_module("traverse", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    _main()
