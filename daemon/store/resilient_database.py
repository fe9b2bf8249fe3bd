"""The outbox's database through all that can happen to it; used by one thread.

Opens it, sets a damaged one aside and begins a new one, notices that it has been
removed, and tries again where the disk had no room or gave errors.
"""

import contextlib
import logging
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.records import (
    Entry,
    Figures,
    StorageError,
    StoreRefusedError,
)
from traverse.daemon.store.salvage import recover_unsent
from traverse.daemon.store.storage_error import (
    is_corruption,
    move_aside,
    needs_reopening,
    storage_error_of,
)

log = logging.getLogger("traverse.daemon.outbox")

T = TypeVar("T")


class ResilientDatabase:
    """Keeps points, and says why where it cannot.

    Args:
        path: of the database.
        replaced: called with a text when a new database has been begun for one that
            was no good any more.

    Attributes:
        trouble: why points cannot be kept now; None while they can.
        figures: of the database when it could last be read.
    """

    def __init__(self, path: Path, replaced: Callable[[str], None]) -> None:
        self._path = path
        self._replaced = replaced
        self._store: MessageDatabase | None = None
        self._last_number = 0
        self.trouble: StorageError | None = None
        self.figures = Figures()

    def open(self) -> None:
        """Open the database; what prevents it is in `trouble` then.

        Raises:
            StoreRefusedError: it must be left alone.
        """
        with contextlib.suppress(sqlite3.Error, OSError):
            self.use(lambda store: None)

    def close(self) -> None:
        """Close the database."""
        if self._store is not None:
            store, self._store = self._store, None
            self._last_number = store.last_number
            try:
                store.close()
            except sqlite3.Error as error:
                log.warning("%s", storage_error_of(error, self._path).text)

    def add(self, entries: Sequence[Entry]) -> list[int]:
        """Keep messages, all or none; gives their numbers. On return they are safe.

        Raises:
            Exception: they are not kept; `trouble` says why.
        """
        numbers = self.use(lambda store: store.add(entries))
        self.trouble = None
        return numbers

    def use(self, work: Callable[[MessageDatabase], T]) -> T:
        """Do something with the database; with a new one if it turns out damaged.

        Raises:
            Exception: it cannot be done; `trouble` says why.
        """
        try:
            try:
                return work(self._opened())
            except sqlite3.Error as error:
                if not is_corruption(error):
                    raise
                self._begin_anew(error)
                return work(self._opened())
        except StoreRefusedError as error:
            self.trouble = StorageError(str(error), "see there")
            raise
        except Exception as error:
            if not isinstance(error, sqlite3.Error | OSError):
                log.exception("fault in the outbox")
            self.trouble = storage_error_of(error, self._path)
            if needs_reopening(error):
                self.close()
            raise

    def look(self) -> None:
        """See whether the trouble is over, and whether the file is still there."""
        if self._store is not None and not self._store.is_file_unchanged:
            self.close()
            with contextlib.suppress(sqlite3.Error, OSError, StoreRefusedError):
                self.use(lambda store: None)
                self._replaced(
                    f"{self._path} had been moved or removed while the daemon used it; "
                    "what is there now is used instead"
                )
        if self.trouble is not None:
            with contextlib.suppress(sqlite3.Error, OSError, StoreRefusedError):
                self.use(MessageDatabase.check_space)
                self.trouble = None

    def count(self) -> None:
        """Bring `figures` up to date."""
        if self._store is not None:
            with contextlib.suppress(sqlite3.Error):
                self.figures = self._store.figures()

    def _opened(self) -> MessageDatabase:
        if self._store is None:
            self._store = MessageDatabase(self._path, self._last_number)
            self._last_number = max(self._last_number, self._store.last_number)
        return self._store

    def _begin_anew(self, error: sqlite3.Error) -> None:
        """Set a damaged database aside; a new one gets what can be taken over."""
        self.close()
        name = move_aside(self._path)
        store, entries = self._opened(), []
        with contextlib.suppress(sqlite3.Error):
            entries = recover_unsent(name)
            if entries:
                store.add(entries)
        self._replaced(
            f"{self._path} is damaged ({error}); it is now {name}, and a new one has "
            f"been begun, with {len(entries)} points that had not been sent"
        )
