"""Where the log is written: the journal with fields, or lines on standard error.

Nothing secret ever reaches the log: passwords and keys are read where they are used and
are part of no message and no value that is printed.
"""

import faulthandler
import logging
import os
import sys
from typing import Literal

from traverse.daemon.system.journal import JournalHandler
from traverse.daemon.system.log_lines import JsonLines, PlainLines

LIBRARIES = ("asyncio", "can", "canopen", "pymodbus")  # every frame, at their lowest


LogFormat = Literal["auto", "plain", "json", "journal"]
LogLevel = Literal["debug", "info", "warning", "error"]


def start_log(form: LogFormat = "auto", level: LogLevel = "info") -> None:
    """Send all entries of at least a level to one place.

    "auto" is the journal where standard error is connected to it, else plain. A crash,
    or the SIGABRT of a watchdog, leaves the stacks of all threads on standard error.
    """
    if form == "auto":
        form = "journal" if stderr_is_the_journal() else "plain"
    handler: logging.Handler
    if form == "journal":
        handler = JournalHandler()
    else:
        handler = logging.StreamHandler(sys.stderr)
        handler.setFormatter(JsonLines() if form == "json" else PlainLines())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level.upper())
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
