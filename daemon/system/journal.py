"""Entries of the log to journald, with fields, in its native protocol.

One datagram an entry: `NAME=value` lines, or for a value with a line break the name
alone, its length (8 bytes, little-endian) and the value. An entry too long for a
datagram is sent as a sealed file in memory, by its descriptor. See
systemd's "Native Journal Protocol".
"""

import errno
import fcntl
import logging
import os
import socket
import sys
from pathlib import Path

from traverse.daemon.system.log_lines import fields_of

SOCKET = Path("/run/systemd/journal/socket")
PRIORITIES = {
    logging.DEBUG: 7,
    logging.INFO: 6,
    logging.WARNING: 4,
    logging.ERROR: 3,
    logging.CRITICAL: 2,
}
SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE | fcntl.F_SEAL_SEAL
TOO_LONG = (errno.EMSGSIZE, errno.ENOBUFS)


class JournalHandler(logging.Handler):
    """Sends entries without ever waiting for the journal.

    What it does not take, because it is busy or absent, is written to standard error,
    with the priority in front as systemd reads it there.
    """

    def __init__(self, path: Path = SOCKET) -> None:
        super().__init__()
        self._path = str(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def emit(self, record: logging.LogRecord) -> None:
        """Send one entry."""
        try:
            try:
                self._send(entry_of(record))
            except OSError:
                priority = PRIORITIES.get(record.levelno, 6)
                text = self.format(record).replace("\n", f"\n<{priority}>")
                sys.stderr.write(f"<{priority}>{text}\n")
        except Exception:  # noqa: BLE001 - logging's own way: never into the caller
            self.handleError(record)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
        super().close()

    def _send(self, entry: bytes) -> None:
        try:
            self._socket.sendto(entry, self._path)
        except OSError as error:
            if error.errno not in TOO_LONG:
                raise
            self._send_as_file(entry)

    def _send_as_file(self, entry: bytes) -> None:
        flags = os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING
        with open(os.memfd_create("journal-entry", flags), "wb", buffering=0) as file:
            file.write(entry)
            fcntl.fcntl(file, fcntl.F_ADD_SEALS, SEALS)
            number = file.fileno().to_bytes(4, sys.byteorder)
            rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, number)]
            self._socket.sendmsg([b""], rights, 0, self._path)


def entry_of(record: logging.LogRecord) -> bytes:
    """An entry's bytes in the native protocol."""
    message = record.getMessage()
    if record.exc_info:
        message += "\n" + logging.Formatter().formatException(record.exc_info)
    fields: dict[str, object] = {
        "MESSAGE": message,
        "PRIORITY": PRIORITIES.get(record.levelno, 6),
        "SYSLOG_IDENTIFIER": "traverse",
        "LOGGER": record.name,
        "THREAD_NAME": record.threadName,
        "CODE_FILE": record.pathname,
        "CODE_LINE": record.lineno,
        "CODE_FUNC": record.funcName,
    }
    told = fields_of(record)
    fields |= {f"TRAVERSE_{name.upper()}": value for name, value in told.items()}
    return b"".join(_field(name, str(value)) for name, value in fields.items())


def _field(name: str, value: str) -> bytes:
    data = value.encode("utf-8", "replace")
    if b"\n" not in data:
        return b"%b=%b\n" % (name.encode(), data)
    return b"%b\n%b%b\n" % (name.encode(), len(data).to_bytes(8, "little"), data)
