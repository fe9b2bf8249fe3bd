"""Programs that are started again whenever they end, as systemd does."""

import asyncio
import contextlib
import os
import signal
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

PAUSE_S = 0.2
CHECKOUT = Path(__file__).parent.parent.parent


class Kept:
    """A program that is kept running.

    Args:
        name: of its log.
        folder: where it runs and logs.
        command: gives the command line of the next life.
        environment: in addition to ours.

    Attributes:
        kills: how often it was killed.
        starts: how often it was started.
        down_s: so long it stays away after a kill.
    """

    def __init__(
        self,
        name: str,
        folder: Path,
        command: Callable[[], list[str]],
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.name = name
        self._folder = folder
        self._command = command
        paths = {"PYTHONPATH": str(CHECKOUT)}
        self._environment = {**os.environ, **paths, **(environment or {})}
        self._process: subprocess.Popen[bytes] | None = None
        self.kills = 0
        self.starts = 0
        self.down_s = PAUSE_S

    @property
    def is_running(self) -> bool:
        """Whether it lives now."""
        return self._process is not None and self._process.poll() is None

    @property
    def pid(self) -> int:
        """Of the present life."""
        if self._process is None:
            raise RuntimeError(f"{self.name} was not started")
        return self._process.pid

    def start(self) -> None:
        """Begin a life."""
        self.starts += 1
        with (self._folder / f"{self.name}.log").open("ab") as log:
            self._process = subprocess.Popen(
                self._command(),
                cwd=self._folder,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )

    def kill(self, down_s: float) -> None:
        """End it as a power cut does; it comes back after a while."""
        if self._process is not None and self.is_running:
            self.down_s = down_s
            self._process.kill()
            self.kills += 1

    async def keep(self) -> None:
        """Start it again after every end, until cancelled."""
        while True:
            self.start()
            while self.is_running:  # noqa: ASYNC110 - no event tells of it
                await asyncio.sleep(0.05)
            await asyncio.sleep(self.down_s)
            self.down_s = PAUSE_S

    def stop(self, number: int = signal.SIGTERM) -> None:
        """End it in order, or not."""
        if self._process is None:
            return
        self._process.send_signal(number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(10)
        self._process.kill()
        self._process.wait()
