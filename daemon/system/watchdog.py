"""Feeds systemd's watchdog as long as the measuring really goes on.

Not a timer that says "I am here": every thread that measures, keeps or records has a
`Pulse`, and is looked at before each feeding. The event loop shows itself by feeding
at all, and by taking what readers deliver. Whoever is stuck stops the feeding, and
systemd starts the daemon anew. A device that is gone is not stuck: its reader goes on
trying.
"""

import asyncio
from collections.abc import Callable, Iterable

from traverse.daemon.acquisition.device import Device
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.system.systemd_notify import Notifier
from traverse.drivers.base.heartbeat import Pulse

FEEDS = 4  # in the time after which systemd would act
SHARE = 0.5  # of that time: how long one turn of a thread may take
TURN_S = 3.0  # at least: a question to a device that does not answer takes its time
ALONE_S = 20.0  # where no service manager watches
LOOK_S = 5.0


class Watchdog:
    """Looks at all signs of life and feeds.

    Args:
        notifier: the way to the service manager.
        devices: all of the configuration.
        pulses: gives the signs of life of all other threads.
        events: where it is told who is stuck.
    """

    def __init__(
        self,
        notifier: Notifier,
        devices: Iterable[Device],
        pulses: Callable[[], Iterable[Pulse]],
        events: EventLog,
    ) -> None:
        self._notifier = notifier
        self._devices = list(devices)
        self._pulses = pulses
        self._events = events
        self._untaken: dict[str, int | None] = {}
        self._stuck: set[str] = set()
        watchdog_s = notifier.watchdog_s
        self._limit_s = max(TURN_S, SHARE * watchdog_s) if watchdog_s else ALONE_S
        self._period_s = watchdog_s / FEEDS if watchdog_s else LOOK_S

    async def run(self) -> None:
        """Look and feed until cancelled."""
        while True:
            self.look()
            await asyncio.sleep(self._period_s)

    def look(self) -> bool:
        """Feed if all go on; tell who does not."""
        found = dict(self._found())
        for name in self._stuck - set(found):
            self._tell(name, f"the {name} goes on", active=False)
        for name, text in found.items():
            self._tell(name, text, active=True)
        self._stuck = set(found)
        if not found:
            self._notifier.feed()
        return not found

    def _found(self) -> Iterable[tuple[str, str]]:
        for pulse in (*(d.driver.pulse for d in self._devices), *self._pulses()):
            silent_s = pulse.overdue_s(self._limit_s)
            if silent_s is not None:
                yield pulse.name, f"the {pulse.name} has not moved for {silent_s:.1f} s"
        for device in self._devices:
            name, delivery_queue = device.section.id, device.delivery_queue
            before, self._untaken[name] = self._untaken.get(name), None
            if delivery_queue.is_due:
                self._untaken[name] = delivery_queue.taken
                if before == delivery_queue.taken:  # so it was at the last look
                    text = f"nobody takes what the reader of {name} delivers"
                    yield f"taker of {name}", text

    def _tell(self, name: str, text: str, *, active: bool) -> None:
        self._events.change(
            active,
            "error",
            "watchdog.stuck",
            text,
            source=name.replace(" ", "-"),
            remedy="systemd starts the daemon anew; report it with the log"
            if active and self._notifier.watchdog_s
            else "start the daemon anew; report it with the log"
            if active
            else "",
        )
