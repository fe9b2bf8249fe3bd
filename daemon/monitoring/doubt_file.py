"""What events put in doubt after it was published, beside the outbox.

Points are stored as they were published; `traverse export` of an outbox marks them.
"""

import json
import logging
from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from traverse.strict_toml.problems import reason_of
from traverse.strict_toml.writing import write_atomically

log = logging.getLogger("traverse.daemon.service")
MOST_DOUBTS = 1000


class DoubtFile:
    """The latest of them, a line of JSON each, written by a thread of its own.

    Args:
        path: of the file, which need not exist.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._thread = ThreadPoolExecutor(1, "doubts")
        self._lines: deque[str] | None = None  # not read yet

    def add(self, data: Mapping[str, object]) -> None:
        """Note the data of an event that names earlier numbers; no other."""
        if "from_ns" in data:
            self._thread.submit(self._add, json.dumps(data)).add_done_callback(_report)

    def close(self) -> None:
        """Write what waits."""
        self._thread.shutdown()

    def _add(self, line: str) -> None:
        if self._lines is None:
            text = self._path.read_text("utf-8") if self._path.exists() else ""
            self._lines = deque(text.splitlines(), maxlen=MOST_DOUBTS)
        self._lines.append(line)
        write_atomically(self._path, "\n".join((*self._lines, "")))


def _report(done: "Future[None]") -> None:
    if (error := done.exception()) is not None:
        log.warning(
            "what an event put in doubt is not marked in the outbox: %s",
            reason_of(error),
        )
