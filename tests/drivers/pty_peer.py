"""The device's end of a pty: a cable that tests plug in and out."""

import os
import threading
import tty
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Self


class PtyPeer(ABC):
    """A peer that lives in a thread of its own while it is plugged in.

    Args:
        link: where the host finds the port; it keeps its name when plugged again.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self._thread: threading.Thread | None = None
        self._plugged = False

    def plug(self) -> None:
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(slave))
        os.close(slave)
        os.set_blocking(self._master, False)
        self._plugged = True
        self._thread = threading.Thread(target=self._live, name=type(self).__name__)
        self._thread.start()

    def unplug(self) -> None:
        if self._thread is not None:
            self._plugged = False
            self._thread.join()
            self._thread = None
            self.link.unlink(missing_ok=True)
            os.close(self._master)

    def __enter__(self) -> Self:
        self.plug()
        return self

    def __exit__(self, *error: object) -> None:
        self.unplug()

    @abstractmethod
    def _live(self) -> None:
        """Answer until it is no longer plugged in."""
