"""What the daemon tells systemd: sd_notify(3), in a few lines of our own.

Lines such as `READY=1` go as one datagram to the socket that `$NOTIFY_SOCKET` names.
Without it, as when the daemon is started by hand, nothing is sent.
"""

import os
import socket
import time
from collections.abc import Mapping

ABSTRACT = "@"  # how the name of a socket outside the file system begins


class Notifier:
    """The way to the service manager.

    Args:
        environment: where `NOTIFY_SOCKET`, `WATCHDOG_USEC` and `WATCHDOG_PID` stand.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        path = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + path[1:] if path.startswith(ABSTRACT) else path
        self.watchdog_s = _watchdog_s(environment) if path else None

    def send(self, *lines: str) -> None:
        """Send assignments in one datagram; one that finds no room is lost."""
        if not self._address:
            return
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as out:
                out.setblocking(False)
                out.sendto("\n".join(lines).encode(), self._address)
        except OSError:  # a manager that restarts must not stop the measuring
            return

    def ready(self) -> None:
        """Start-up, or a reload, has ended."""
        self.send("READY=1")

    def reloading(self) -> None:
        """A reload begins; `ready` ends it. Valid for notify and notify-reload."""
        now_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
        self.send("RELOADING=1", f"MONOTONIC_USEC={now_us}")

    def stopping(self, limit_s: float) -> None:
        """The end begins and takes at most ``limit_s``."""
        self.send("STOPPING=1", f"EXTEND_TIMEOUT_USEC={int(limit_s * 1e6)}")

    def starting(self, limit_s: float) -> None:
        """Start-up goes on and takes at most ``limit_s``."""
        self.send(f"EXTEND_TIMEOUT_USEC={int(limit_s * 1e6)}")

    def status(self, text: str) -> None:
        """A line that `systemctl status` shows."""
        self.send(f"STATUS={' '.join(text.split())}")

    def feed(self) -> None:
        """Everything goes on: the watchdog waits anew."""
        self.send("WATCHDOG=1")


def _watchdog_s(environment: Mapping[str, str]) -> float | None:
    """After how long without feeding this process would be killed."""
    told, process = environment.get("WATCHDOG_USEC"), environment.get("WATCHDOG_PID")
    if process is not None and process != str(os.getpid()):
        return None  # it is meant for another process
    return int(told) * 1e-6 if told is not None and told.isdecimal() else None
