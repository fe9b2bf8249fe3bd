"""Notification of systemd, sd_notify(3), with its watchdog.

Lines such as `READY=1` are sent as datagrams to the socket that `$NOTIFY_SOCKET` names;
without it nothing is sent.

Every thread that measures, stores or records has a `Heartbeat`, checked before each
feeding of the watchdog. The event loop proves itself by feeding, and by taking what
readers deliver. A stuck thread stops the feeding, and systemd restarts the daemon. A
lost device is not stuck: its reader keeps trying.
"""

import asyncio
import os
import socket
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import InitVar, dataclass

from traverse.daemon.acquisition.device import Device
from traverse.daemon.monitoring.events import EventLog
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.plurals import counted

ABSTRACT = "@"  # how the name of a socket outside the file system begins


class Notifier:
    """Connection to the service manager.

    Args:
        environment: has `NOTIFY_SOCKET`, `WATCHDOG_USEC` and `WATCHDOG_PID`.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        path = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + path[1:] if path.startswith(ABSTRACT) else path
        self._status = ""
        self.watchdog_s = _watchdog_s(environment) if path else None

    def send(self, *lines: str) -> None:
        """Send assignments in one datagram; it is lost if there is no room."""
        if not self._address:
            return
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as out:
                out.setblocking(False)
                out.sendto("\n".join(lines).encode(), self._address)
        except OSError:  # a manager that restarts must not stop the measuring
            return

    def ready(self) -> None:
        self.send("READY=1")

    def reloading(self) -> None:
        """Report the begin of a reload, for Type=notify and notify-reload."""
        now_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
        self.send("RELOADING=1", f"MONOTONIC_USEC={now_us}")

    def stopping(self, limit_s: float) -> None:
        self.send("STOPPING=1", f"EXTEND_TIMEOUT_USEC={int(limit_s * 1e6)}")

    def starting(self, limit_s: float) -> None:
        self.send(f"EXTEND_TIMEOUT_USEC={int(limit_s * 1e6)}")

    def status(self, text: str) -> None:
        """Send the line that `systemctl status` shows, if it has changed."""
        if text != self._status:
            self._status = text
            self.send(f"STATUS={' '.join(text.split())}")

    def feed(self) -> None:
        self.send("WATCHDOG=1")


def _watchdog_s(environment: Mapping[str, str]) -> float | None:
    """Return after how long without feeding this process is killed."""
    if environment.get("WATCHDOG_PID") not in (None, str(os.getpid())):
        return None  # it is meant for another process
    timeout_us = environment.get("WATCHDOG_USEC", "")
    return int(timeout_us) * 1e-6 if timeout_us.isdecimal() else None


class StatusLine:
    """Composes the status line; remembers since when states last."""

    def __init__(
        self, now: Callable[[], str] = lambda: time.strftime("%H:%M:%S")
    ) -> None:
        self._now = now
        self._since: dict[str, tuple[str, str]] = {}

    def text(
        self, doing: str, devices: Mapping[str, str], broker: str, waiting: int
    ) -> str:
        """Return a line such as "measuring: 2 devices, broker lost since 12:03:11".

        ``devices`` are states by name, ``waiting`` the points that the broker lacks.
        """
        ready = sum(state == "ready" for state in devices.values())
        since = {name: self._time(name, state) for name, state in devices.items()}
        broker_since = self._time("broker/", broker)
        parts = [counted(ready, "device")]
        parts += [
            f"{name} {state} since {since[name]}"
            for name, state in devices.items()
            if state != "ready"
        ]
        if broker != "connected":
            parts.append(f"broker {broker} since {broker_since}")
        if waiting:
            parts.append(counted(waiting, "point", "wait"))
        return f"{doing}: {', '.join(parts)}"

    def _time(self, name: str, state: str) -> str:
        before, since = self._since.get(name, ("", ""))
        if before != state:
            since = self._now()
            self._since[name] = state, since
        return since


FEEDS = 4  # in the time after which systemd would act
SHARE = 0.5  # of that time: how long one turn of a thread may take
MIN_TURN_S = 3.0  # at least: a question to a device that does not answer takes its time
ALONE_S = 20.0  # where no service manager watches
CHECK_S = 5.0


@dataclass(eq=False)
class Watchdog:
    """Checks all heartbeats and feeds the watchdog."""

    notifier: Notifier
    devices: InitVar[Iterable[Device]]
    heartbeats: Callable[[], Iterable[Heartbeat]]
    events: EventLog

    def __post_init__(self, devices: Iterable[Device]) -> None:
        self._devices = list(devices)
        self._last_taken: dict[str, int | None] = {}
        self._stuck: set[str] = set()
        watchdog_s = self.notifier.watchdog_s
        self._limit_s = max(MIN_TURN_S, SHARE * watchdog_s) if watchdog_s else ALONE_S
        self._period_s = watchdog_s / FEEDS if watchdog_s else CHECK_S

    async def run(self) -> None:
        while True:
            self.check()
            await asyncio.sleep(self._period_s)

    def check(self) -> bool:
        """Feed unless something is stuck, and report that."""
        stuck = dict(self._found())
        for name in self._stuck - set(stuck):
            self._report(name, f"the {name} continues", active=False)
        for name, text in stuck.items():
            self._report(name, text, active=True)
        self._stuck = set(stuck)
        if not stuck:
            self.notifier.feed()
        return not stuck

    def _found(self) -> Iterable[tuple[str, str]]:
        for heartbeat in (
            *(d.driver.heartbeat for d in self._devices),
            *self.heartbeats(),
        ):
            silent_s = heartbeat.overdue_s(self._limit_s)
            if silent_s is not None:
                yield (
                    heartbeat.name,
                    f"the {heartbeat.name} has not moved for {silent_s:.1f} s",
                )
        for device in self._devices:
            name, delivery_queue = device.section.id, device.delivery_queue
            before, self._last_taken[name] = self._last_taken.get(name), None
            if delivery_queue.is_due:
                self._last_taken[name] = delivery_queue.taken
                if before == delivery_queue.taken:  # as at the last check
                    text = f"deliveries of the reader of {name} are not processed"
                    yield f"taker of {name}", text

    def _report(self, name: str, text: str, *, active: bool) -> None:
        who = "systemd starts" if self.notifier.watchdog_s else "start"
        self.events.change(
            active,
            "error",
            "watchdog.stuck",
            text,
            source=name.replace(" ", "-"),
            remedy=f"{who} the daemon anew; report it with the log" if active else "",
        )
