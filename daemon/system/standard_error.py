"""Standard error as a stream that never waits for its reader.

Strategy: the event loop writes the log. A pipe that nobody reads, a stopped terminal or
a hanging journal would block it in `write`. The system reports a pipe as writable when
it takes `PIPE_BUF` bytes at once; so pieces of that size are written after polling,
sockets are written without waiting, and files are always ready. Lines that are not
taken are dropped and counted; the next one that is taken says so.
"""

import contextlib
import os
import select
import socket
import stat
import sys
from typing import TextIO

from traverse.plurals import counted

PIECE_BYTES = select.PIPE_BUF


class StandardError:
    """Destination of log lines.

    Attributes:
        n_dropped: lines that standard error did not take.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream
        self.n_dropped = 0
        self._n_unreported = 0

    def write(self, text: str) -> None:
        """Write a line, or count it as dropped."""
        stream = self._stream or sys.stderr
        try:
            number = stream.fileno()
        except (OSError, ValueError):  # a program has put something else in its place
            stream.write(text)
            return
        report = ""
        if self._n_unreported:
            lines = counted(self._n_unreported, "line")
            report = f"{lines} dropped here: they were not taken\n"
        if _written(number, (report + text).encode("utf-8", "backslashreplace")):
            self._n_unreported = 0
        else:
            self.n_dropped += 1
            self._n_unreported += 1

    def flush(self) -> None:
        """Do nothing: nothing is buffered."""


STANDARD_ERROR = StandardError()


def _written(number: int, data: bytes) -> bool:
    """Write to a descriptor while it takes bytes; return whether it took all."""
    mode = os.fstat(number).st_mode
    if stat.S_ISREG(mode):
        with contextlib.suppress(OSError):  # its disk is full
            return os.write(number, data) == len(data)
        return False
    ready = select.poll()
    ready.register(number, select.POLLOUT)
    while data:
        try:
            if not ready.poll(0):
                return False
            if stat.S_ISSOCK(mode):
                with socket.socket(fileno=os.dup(number)) as line:
                    n_written = line.send(data, socket.MSG_DONTWAIT)
            else:
                n_written = os.write(number, data[:PIECE_BYTES])
        except OSError:  # nobody is there any more, or it is full
            return False
        data = data[n_written:]
    return True
