"""Log destinations: the journal with fields, or lines on standard error.

Passwords and keys are read where they are used and are part of no message and no
printed value.
"""

import errno
import faulthandler
import fcntl
import json
import logging
import os
import socket
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from traverse.daemon.system.standard_error import STANDARD_ERROR
from traverse.protocol.printable import printable

LIBRARIES = ("asyncio", "can", "canopen", "pymodbus")  # every frame, at their lowest
LogFormat = Literal["auto", "plain", "json", "journal"]
LogLevel = Literal["debug", "info", "warning", "error"]
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


class PlainLines(logging.Formatter):
    """Local time, level, text; further lines are indented."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)-7s %(message)s", "%H:%M:%S")

    def format(self, record: logging.LogRecord) -> str:
        first, *further = map(printable, super().format(record).split("\n"))
        return "\n".join(
            (first, *(line if line[:1] == " " else f" {line}" for line in further))
        )


class JsonLines(logging.Formatter):
    """One object a line: `time` (UTC), `level`, `logger`, `message`, fields, fault."""

    def format(self, record: logging.LogRecord) -> str:
        moment = datetime.fromtimestamp(record.created, UTC)
        entry: dict[str, object] = {
            "time": moment.isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **fields_of(record),
        }
        if record.exc_info:
            entry["fault"] = self.formatException(record.exc_info)
        text = json.dumps(entry, ensure_ascii=False, default=str)
        if text.isprintable():
            return text
        return "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)


def fields_of(record: logging.LogRecord) -> Mapping[str, str | int]:
    fields: Mapping[str, str | int] = getattr(record, "fields", {})
    return {name: value for name, value in fields.items() if value != ""}


class JournalHandler(logging.Handler):
    """Sends entries to journald in its native protocol, without waiting.

    One datagram an entry: `NAME=value` lines, or for a value with a line break the name
    alone, its length (8 bytes, little-endian) and the value. Longer entries are sent as
    a sealed memory file, by its descriptor.

    Entries that the journal does not take go to standard error, with the priority in
    front as systemd reads it there.
    """

    def __init__(self, path: Path = SOCKET) -> None:
        super().__init__()
        self._path = str(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def emit(self, record: logging.LogRecord) -> None:
        try:
            try:
                self._send(entry_of(record))
            except OSError:
                priority = PRIORITIES.get(record.levelno, 6)
                text = self.format(record).replace("\n", f"\n<{priority}>")
                STANDARD_ERROR.write(f"<{priority}>{text}\n")
        except Exception:  # noqa: BLE001 - logging's own way: never into the caller
            self.handleError(record)

    def close(self) -> None:
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
    """Encode an entry in the native protocol."""
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
    extra_fields = fields_of(record)
    fields |= {
        f"TRAVERSE_{name.upper()}": value for name, value in extra_fields.items()
    }
    return b"".join(_field(name, str(value)) for name, value in fields.items())


def _field(name: str, value: str) -> bytes:
    data = value.encode("utf-8", "replace")
    if b"\n" not in data:
        return b"%b=%b\n" % (name.encode(), data)
    return b"%b\n%b%b\n" % (name.encode(), len(data).to_bytes(8, "little"), data)


def start_log(form: LogFormat = "auto", level: LogLevel = "info") -> None:
    """Log all entries of at least a level.

    "auto" is the journal if standard error is connected to it, else plain. A crash, or
    the SIGABRT of a watchdog, leaves the stacks of all threads on standard error.
    """
    if form == "auto":
        form = "journal" if stderr_is_the_journal() else "plain"
    handler: logging.Handler
    if form == "journal":
        handler = JournalHandler()
    else:
        handler = logging.StreamHandler(STANDARD_ERROR)
        handler.setFormatter(JsonLines() if form == "json" else PlainLines())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level.upper())
    for name in LIBRARIES:
        logging.getLogger(name).setLevel(max(root.level, logging.INFO))
    faulthandler.enable(sys.stderr)


def stderr_is_the_journal() -> bool:
    """Return whether `$JOURNAL_STREAM` identifies standard error."""
    try:
        status = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError):
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"
