"""Where the log is written: the journal with fields, or lines on standard error.

Nothing secret ever reaches the log: passwords and keys are read where they are used and
are part of no message and no value that is printed.
"""

import faulthandler
import logging
import os
import sys
from enum import StrEnum

from traverse.daemon.system.journal import JournalHandler
from traverse.daemon.system.log_lines import JsonLines, PlainLines

LIBRARIES = ("asyncio", "can", "canopen", "pymodbus")  # every frame, at their lowest


class LogFormat(StrEnum):
    """How entries are written."""

    AUTO = "auto"
    PLAIN = "plain"
    JSON = "json"
    JOURNAL = "journal"


class LogLevel(StrEnum):
    """Which entries are written."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


def start_log(
    form: LogFormat = LogFormat.AUTO, level: LogLevel = LogLevel.INFO
) -> None:
    """Send all entries of at least a level to one place.

    `AUTO` is the journal where standard error is connected to it, else plain. A crash,
    or the SIGABRT of a watchdog, leaves the stacks of all threads on standard error.
    """
    if form is LogFormat.AUTO:
        form = LogFormat.JOURNAL if stderr_is_the_journal() else LogFormat.PLAIN
    handler: logging.Handler
    if form is LogFormat.JOURNAL:
        handler = JournalHandler()
    else:
        handler = logging.StreamHandler(sys.stderr)
        handler.setFormatter(JsonLines() if form is LogFormat.JSON else PlainLines())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level.value.upper())
    for name in LIBRARIES:
        logging.getLogger(name).setLevel(max(root.level, logging.INFO))
    logging.getLogger("mqtt").setLevel(logging.ERROR)  # aiomqtt's own chatter
    faulthandler.enable(sys.stderr)


def stderr_is_the_journal() -> bool:
    """Whether `$JOURNAL_STREAM` names the file that standard error is."""
    try:
        told = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError):
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{told.st_dev}:{told.st_ino}"
