"""Devices that tests plug in and out, and a driver on the port of one."""

import asyncio
import contextlib
import os
import select
import threading
import time
import tty
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any, Self

import pytest

from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.driver import Driver


class Peer(ABC):
    """A device that lives in a thread of its own while it is plugged in.

    Attributes:
        link: where the host finds the port.
    """

    link: Path

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None
        self._plugged = False

    def plug(self) -> None:
        if self._plugged:
            return
        self._open()
        self._plugged = True
        self._thread = threading.Thread(target=self._live, name=type(self).__name__)
        self._thread.start()

    def unplug(self) -> None:
        if self._thread is not None:
            self._plugged = False
            self._thread.join()
            self._thread = None
            self._close()

    def __enter__(self) -> Self:
        self.plug()
        return self

    def __exit__(self, *error: object) -> None:
        self.unplug()

    @abstractmethod
    def _open(self) -> None:
        """Open the port."""

    @abstractmethod
    def _close(self) -> None:
        """Close the port."""

    @abstractmethod
    def _live(self) -> None:
        """Answer until unplugged."""


class PtyPeer(Peer):
    """The device's end of a pty.

    Args:
        link: where the host finds the port; the name stays when it is plugged again.
    """

    def __init__(self, link: Path) -> None:
        super().__init__()
        self.link = link

    def receive(self, seconds: float) -> bytes:
        """Return bytes that the host has sent; none if it does not within a time."""
        until_s = time.monotonic() + seconds
        while (left_s := until_s - time.monotonic()) > 0:
            if select.select([self._master], [], [], left_s)[0]:
                try:
                    return os.read(self._master, 4096)
                except OSError:  # no host has the port open
                    time.sleep(0.001)
        return b""

    def send(self, data: bytes) -> None:
        """Send to the host; bytes that do not fit into the line are lost."""
        with contextlib.suppress(OSError):
            os.write(self._master, data)

    def _open(self) -> None:
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(slave))
        os.close(slave)
        os.set_blocking(self._master, False)

    def _close(self) -> None:
        self.link.unlink(missing_ok=True)
        os.close(self._master)


class PeerRig:
    """A driver on the port of a peer that answers or sends by itself."""

    def __init__(self, peer: Peer, make: type[Driver], **options: object) -> None:
        self.peer = peer
        self.port = str(peer.link)
        self.delivery_queue = DeliveryQueue(asyncio.get_running_loop())
        if "ports" not in options:
            options["port"] = self.port
        valid = make.options_class(**options)
        self.driver = make("device", valid, self.delivery_queue)
        self.plug, self.unplug = peer.plug, peer.unplug

    def emit(self, n: int) -> None:
        """Nothing to do."""


def rig_fixture(make: Callable[[Path], PeerRig]) -> Any:  # noqa: ANN401 - of pytest
    @pytest.fixture
    async def rig(tmp_path: Path) -> AsyncIterator[PeerRig]:
        rig = make(tmp_path)
        rig.plug()
        yield rig
        rig.driver.close()
        rig.unplug()

    return rig
