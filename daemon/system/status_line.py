"""The line that `systemctl status` shows: how the daemon is, for people."""

import time
from collections.abc import Callable, Mapping


def local_time() -> str:
    """Hours, minutes and seconds, as in the log."""
    return time.strftime("%H:%M:%S")


class StatusLine:
    """Makes the line; remembers since when something has been as it is.

    Args:
        now: tells the time of day.
    """

    def __init__(self, now: Callable[[], str] = local_time) -> None:
        self._now = now
        self._since: dict[str, tuple[str, str]] = {}

    def text(
        self, doing: str, devices: Mapping[str, str], broker: str, waiting: int
    ) -> str:
        """One line such as "measuring: 2 devices, broker lost since 12:03:11".

        Args:
            doing: what the daemon does.
            devices: state of each, by its name.
            broker: state of the connection.
            waiting: points that the broker does not have yet.
        """
        ready = sum(state == "ready" for state in devices.values())
        since = {name: self._time(name, state) for name, state in devices.items()}
        broker_since = self._time("broker/", broker)
        parts = [f"{ready} device{'s' * (ready != 1)}"]
        parts += [
            f"{name} {state} since {since[name]}"
            for name, state in devices.items()
            if state != "ready"
        ]
        if broker != "connected":
            parts.append(f"broker {broker} since {broker_since}")
        if waiting:
            parts.append("1 point waits" if waiting == 1 else f"{waiting} points wait")
        return f"{doing}: {', '.join(parts)}"

    def _time(self, name: str, state: str) -> str:
        """Local time at which a state was first told."""
        before, since = self._since.get(name, ("", ""))
        if before != state:
            since = self._now()
            self._since[name] = state, since
        return since
