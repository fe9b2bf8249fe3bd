"""Record, in a small file, of the message that a database stored last.

Written soon after a commit and never synced, it is never ahead of a sound database,
even after a power cut. A database that has less has lost data: its log was damaged or
removed, or it is new, or an old copy.
"""

import contextlib
import json
import os
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter

FILE_BYTES = 512
OWNER_ONLY = 0o600
_VALUES = TypeAdapter(tuple[int, str, int, int])


@dataclass(frozen=True, slots=True)
class LastStored:
    """The last message.

    Attributes:
        number: of the message; see `StoredMessage`.
        unsent: how many messages the broker lacked.
    """

    number: int = 0
    session: str = ""
    seq: int = 0
    unsent: int = 0


class LastStoredFile:
    """The file; if it cannot be used, nothing is known."""

    def __init__(self, database: Path) -> None:
        self._path = database.with_suffix(".last")
        self._descriptor: int | None = None
        with contextlib.suppress(OSError):
            self._descriptor = os.open(
                self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, OWNER_ONLY
            )

    def read(self) -> LastStored:
        """Return its content; that of an empty database if it cannot be read."""
        if self._descriptor is None:
            return LastStored()
        try:
            text = os.pread(self._descriptor, FILE_BYTES, 0)
            return LastStored(*_VALUES.validate_json(text, strict=True))
        except (OSError, ValueError):
            return LastStored()

    def write(self, last: LastStored) -> None:
        if self._descriptor is not None:
            text = json.dumps([last.number, last.session, last.seq, last.unsent]).ljust(
                FILE_BYTES
            )
            with contextlib.suppress(OSError):  # the database reports a full disk
                os.pwrite(self._descriptor, text.encode(), 0)

    def close(self) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
