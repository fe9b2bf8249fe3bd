"""Workers of xdist, forked from a process that has imported all tests.

Imports are most of what a worker computes before its first test: six seconds for the
whole suite. What execnet starts as a worker's interpreter is this file: it passes its
files to that process and waits until the worker, forked there, has ended.

    python forked_workers.py serve SOCKET ARGUMENT...    imports what pytest collects
    python forked_workers.py worker SOCKET [...]         execnet's interpreter
"""

import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
import types
from pathlib import Path

STANDARD_FILES = (0, 1, 2)


class ForkedWorkers:
    """The process that workers are forked from.

    Args:
        folder: for its socket.
        arguments: of pytest, to collect.
    """

    def __init__(self, folder: Path, arguments: list[str]) -> None:
        self._socket = folder / "workers"
        # Workers wait in its queue while it imports.
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(str(self._socket))
        listener.listen(64)
        with listener:
            self._process = subprocess.Popen(
                [sys.executable, __file__, "serve", str(listener.fileno()), *arguments],
                pass_fds=[listener.fileno()],
                stdin=subprocess.PIPE,  # it ends when this process does
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )

    @property
    def interpreter(self) -> str:
        return f"{sys.executable} -I -S {__file__} worker {self._socket}"

    def close(self) -> None:
        self._process.terminate()
        self._process.communicate()


def _serve(listener: socket.socket, arguments: list[str]) -> None:
    """Import the modules that pytest collects; fork a worker for each connection."""
    import pytest  # noqa: PLC0415 - the interpreter of a worker does not need it

    sys.path[0] = os.getcwd()
    pytest.main(["--collect-only", "-q", "-p", "no:cacheprovider", *arguments])
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for workers
    while listener in select.select([listener, 0], [], [])[0]:
        connection, _ = listener.accept()
        _, files, _, _ = socket.recv_fds(connection, 1, len(STANDARD_FILES))
        if os.fork() == 0:
            # The connection stays open, unseen, until the worker has ended.
            connection.detach()
            listener.close()
            _work(files)
            return
        connection.close()
        for file in files:
            os.close(file)


def _work(files: list[int]) -> None:
    """Become the interpreter that execnet has started."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    for number, file in zip(STANDARD_FILES, files, strict=True):
        os.dup2(file, number)
        os.close(file)
    main = sys.modules["__main__"] = types.ModuleType("__main__")
    exec(eval(sys.stdin.readline()), vars(main))


def _main() -> None:
    role, place, *arguments = sys.argv[1:]
    if role == "serve":
        with socket.socket(fileno=int(place)) as listener:
            _serve(listener, arguments)
        return
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(place)
        socket.send_fds(connection, [b"w"], STANDARD_FILES)
        for file in STANDARD_FILES:
            os.close(file)
        with contextlib.suppress(ConnectionError):
            connection.recv(1)  # nothing: the worker has ended


if __name__ == "__main__":
    _main()
