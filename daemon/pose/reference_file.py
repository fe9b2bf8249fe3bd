"""The confirmed references of one arm, on the disk."""

import json
import logging
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from traverse.daemon.pose.references import ReferenceMemory
from traverse.strict_toml.files import json_of
from traverse.strict_toml.writing import write_atomically

log = logging.getLogger("traverse.daemon.service")


class ReferenceFile(ReferenceMemory):
    """The confirmed references of one arm, written by a thread of its own.

    Args:
        path: of the file; there need not be one.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._thread = ThreadPoolExecutor(1, "references")
        try:
            found = json_of(path)
            if not isinstance(found, dict):
                raise ValueError("it is no table")
        except FileNotFoundError:
            super().__init__()
        except (OSError, ValueError) as error:
            log.warning("%s cannot be read, confirm the positions: %s", path, error)
            super().__init__(is_lost=True)
        else:
            super().__init__({str(key): str(value) for key, value in found.items()})

    def add(self, boots: Mapping[str, str]) -> None:
        """These power-ups are confirmed; a crash before it is written asks again."""
        super().add(boots)
        text = json.dumps(self.confirmed, indent=1)
        self._thread.submit(write_atomically, self._path, text).add_done_callback(
            self._report
        )

    def close(self) -> None:
        """Wait until all is written."""
        self._thread.shutdown()

    def _report(self, done: "Future[None]") -> None:
        if (error := done.exception()) is not None:
            log.warning(
                "%s cannot be written, so positions have to be confirmed again after "
                "a restart: %s",
                self._path,
                error,
            )
