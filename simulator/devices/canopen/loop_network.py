"""The `canopen` library's network, driven by the simulator's loop."""

from collections.abc import Callable

from canopen.network import Network


class PeriodicFrame:
    """A frame that the loop sends again and again; the library stops or changes it."""

    def __init__(self, can_id: int, data: bytes, period_s: float) -> None:
        self.can_id, self.data, self.period_s = can_id, bytes(data), period_s
        self.due_s: float | None = None
        self.stopped = False

    def stop(self) -> None:
        """Send it no more."""
        self.stopped = True

    def update(self, data: bytes) -> None:
        """Send something else from now on."""
        self.data = bytes(data)


class LoopNetwork(Network):
    """The library's network without threads: the simulator's loop drives it."""

    def __init__(self, send: Callable[[int, bytes], None]) -> None:
        super().__init__()
        self._send = send
        self._periodic: list[PeriodicFrame] = []

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Put a frame on the bus."""
        del remote
        self._send(can_id, bytes(data))

    def send_periodic(  # type: ignore[override]  # as much of the library's as is used
        self, can_id: int, data: bytes, period: float, remote: bool = False
    ) -> PeriodicFrame:
        """Send a frame every so many seconds."""
        del remote
        task = PeriodicFrame(can_id, data, period)
        self._periodic.append(task)
        return task

    def live(self, now_s: float) -> None:
        """Send what is due."""
        self._periodic = [task for task in self._periodic if not task.stopped]
        for task in self._periodic:
            if task.due_s is None:
                task.due_s = now_s + task.period_s
            while task.due_s <= now_s:
                self._send(task.can_id, task.data)
                task.due_s += task.period_s

    def due_s(self) -> float:
        """When the next frame is due."""
        return min(
            (task.due_s for task in self._periodic if task.due_s is not None),
            default=float("inf"),
        )
