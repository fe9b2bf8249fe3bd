"""What events put in doubt after it was published, in this run and before it.

Points are stored and sent again as they were published; who reads them marks them.
"""

import json
import logging
from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from traverse.protocol.messages.later_doubt import LaterDoubt, doubts_of_lines
from traverse.strict_toml.problems import reason_of
from traverse.strict_toml.writing import write_atomically

log = logging.getLogger("traverse.daemon.service")
MOST_DOUBTS = 1000


class DoubtFile:
    """The latest of them, a line of JSON each, written by a thread of its own.

    Args:
        path: of the file, which need not exist.

    Attributes:
        latest: oldest first.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._thread = ThreadPoolExecutor(1, "doubts")
        self.latest: deque[LaterDoubt] = deque(maxlen=MOST_DOUBTS)
        try:
            if path.exists():
                self.latest.extend(doubts_of_lines(path.read_text("utf-8")))
        except (OSError, TypeError, ValueError) as error:
            log.warning(
                "%s: %s; what events put in doubt before is marked no more",
                *(path, reason_of(error)),
            )

    def add(self, data: Mapping[str, object]) -> None:
        """Note the data of an event that names earlier numbers; no other."""
        if (doubt := LaterDoubt.of(data)) is not None:
            self.latest.append(doubt)
            lines = [json.dumps(held.data) for held in self.latest]
            text = "\n".join((*lines, ""))
            done = self._thread.submit(write_atomically, self._path, text)
            done.add_done_callback(_report)

    def close(self) -> None:
        """Write what waits."""
        self._thread.shutdown()


def _report(done: "Future[None]") -> None:
    if (error := done.exception()) is not None:
        log.warning(
            "what an event put in doubt will not be marked after a restart: %s",
            reason_of(error),
        )
