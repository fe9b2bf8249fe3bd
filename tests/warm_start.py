"""Programs that start quickly: forked from a process that has imported their modules.

Imports are most of what a short program computes, and the tests start hundreds of them.
Modules that a command imported beyond those are imported before the next program of the
same command is forked, by any worker: their names are in a file of the session.

What runs is `python -W error -m traverse` all the same: a process with its own main
module, arguments, folder, environment, files and session, and a child of the test.
Tests of the start itself, of terminals and of the commands on pages begin with a new
interpreter.
"""

import atexit
import contextlib
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

# The folder of a session's results; workers and programs inherit the variable.
FOLDER = "TRAVERSE_TESTS_SHARED"
PR_SET_CHILD_SUBREAPER = 36
LOOK_S = 0.005
MOST_BYTES = 1 << 16


class Process:
    """A child process, with the methods of `subprocess.Popen` that the tests use."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float = math.inf) -> int:
        end_s = time.monotonic() + timeout
        while (status := self.poll()) is None:
            if time.monotonic() > end_s:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout)
            time.sleep(LOOK_S)
        return status

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class WarmStart:
    """The process that programs are forked from; one for all tests of a worker."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._server = subprocess.Popen(
                [sys.executable, "-W", "error", __file__, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
            )
        self._socket = ours

    @property
    def pid(self) -> int:
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


_started: list[WarmStart] = []


def warm_start() -> WarmStart:
    if not _started:
        _started.append(WarmStart())
    return _started[0]


def pids() -> set[int]:
    """Return the process of this worker that programs are forked from, if any."""
    return {server.pid for server in _started}


def close() -> None:
    while _started:
        _started.pop().close()


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
        _import_as_before(arguments)
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


def _file_of(arguments: list[str]) -> Path | None:
    """Return where names of modules are kept that a command imports."""
    command = "-".join(arguments[:1]).replace("/", "_")
    folder = os.environ.get(FOLDER)
    return Path(folder) / f"modules-of-{command}.json" if folder else None


def _import_as_before(arguments: list[str]) -> None:
    """Import the modules of a program of the same command."""
    file = _file_of(arguments)
    if file is not None and file.exists():
        for name in json.loads(file.read_text("utf-8")):
            if name not in sys.modules:
                with contextlib.suppress(ImportError):  # not by this name
                    importlib.import_module(name)


def _note_imports(file: Path, before: frozenset[str]) -> None:
    """Keep the names of modules that a program has imported by its end, in order.

    Parts in C are left out: what uses them has to be imported before.
    """
    names = json.loads(file.read_text("utf-8")) if file.exists() else []
    names += (n for n in sys.modules if not (n in before or n.startswith("_")))
    part = file.with_suffix(f".{os.getpid()}")
    with contextlib.suppress(OSError):  # it may write no files any more
        part.write_text(json.dumps([*dict.fromkeys(names)]), "utf-8")
        part.rename(file)


class Ending:
    """The end of a program, which leaves all objects as they are.

    To free them copies their pages, which is most of what a short program computes.

    Attributes:
        status: the program's exit status; None: it ends as any program.
    """

    def __init__(self) -> None:
        self.status: int | None = None

    def leave(self) -> None:
        """End at once, after all other functions of `atexit`."""
        if self.status is not None:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(self.status)


def _main() -> None:
    ending = Ending()
    atexit.register(ending.leave)  # the first one is called last
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
    if file := _file_of(arguments):
        atexit.register(_note_imports, file, frozenset(sys.modules))
    del sys.modules["traverse.cli.__main__"]
    try:
        runpy.run_module("traverse", run_name="__main__", alter_sys=True)
    except SystemExit as end:
        if isinstance(end.code, int | None):
            ending.status = end.code or 0
        raise


if __name__ == "__main__":
    _main()
