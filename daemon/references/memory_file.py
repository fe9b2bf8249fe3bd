"""The confirmed devices of an arm, on the disk."""

import json
import logging
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from traverse.daemon.references.memory import ConfirmedDevice, ReferenceMemory
from traverse.strict_toml.files import json_of
from traverse.strict_toml.problems import reason_of
from traverse.strict_toml.writing import write_atomically

log = logging.getLogger("traverse.daemon.service")
SCHEMA = "traverse/references/1"


class ReferenceFile(ReferenceMemory):
    """Confirmed devices of one arm, written by a thread of its own.

    Args:
        path: of the file, which need not exist.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._thread = ThreadPoolExecutor(1, "references")
        self._writing: Future[None] | None = None
        try:
            super().__init__(_devices(json_of(path)))
        except FileNotFoundError:
            super().__init__()
        except (OSError, ValueError, TypeError, KeyError) as error:
            log.warning(
                "%s cannot be read, confirm the positions: %s", path, reason_of(error)
            )
            super().__init__(is_lost=True)

    def add(self, devices: Mapping[str, ConfirmedDevice]) -> None:
        """Confirm devices; a crash before the write asks again."""
        super().add(devices)
        values = {name: device.to_values() for name, device in self.devices.items()}
        text = json.dumps({"schema": SCHEMA, "devices": values}, indent=1)
        self._writing = self._thread.submit(write_atomically, self._path, text)
        self._writing.add_done_callback(self._report)

    @property
    def writing(self) -> "Future[None] | None":
        return self._writing

    def close(self) -> None:
        self._thread.shutdown()

    def _report(self, done: "Future[None]") -> None:
        if (error := done.exception()) is not None:
            log.warning(
                "%s cannot be written, so positions have to be confirmed again after "
                "a restart: %s",
                self._path,
                reason_of(error),
            )


def _devices(values: object) -> dict[str, ConfirmedDevice]:
    """Read the devices of the file's values.

    Raises:
        ValueError: damaged or of another version; also TypeError and KeyError.
    """
    if not isinstance(values, dict) or values.get("schema") != SCHEMA:
        raise ValueError(f"no table with the schema {SCHEMA}")
    devices = values["devices"].items() if isinstance(values["devices"], dict) else ()
    return {str(name): ConfirmedDevice.from_values(it) for name, it in devices}
