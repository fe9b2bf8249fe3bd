"""Lines of simulated CANopen nodes: a bus of python-can, or our own adapter."""

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable

import can
from canopen.network import Network


class PeriodicFrame:
    """A frame that the loop sends periodically; the library stops or changes it."""

    def __init__(self, can_id: int, data: bytes, period_s: float) -> None:
        self.can_id, self.data, self.period_s = can_id, bytes(data), period_s
        self.due_s: float | None = None
        self.stopped = False

    def stop(self) -> None:
        self.stopped = True

    def update(self, data: bytes) -> None:
        self.data = bytes(data)


class LoopNetwork(Network):
    """The library's network without threads: the simulator's loop drives it."""

    def __init__(self, send: Callable[[int, bytes], None]) -> None:
        super().__init__()
        self._send = send
        self._periodic: list[PeriodicFrame] = []

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        del remote
        self._send(can_id, bytes(data))

    def send_periodic(  # type: ignore[override]  # as much of the library's as is used
        self, can_id: int, data: bytes, period: float, remote: bool = False
    ) -> PeriodicFrame:
        del remote
        task = PeriodicFrame(can_id, data, period)
        self._periodic.append(task)
        return task

    def live(self, now_s: float) -> None:
        self._periodic = [task for task in self._periodic if not task.stopped]
        for task in self._periodic:
            if task.due_s is None:
                task.due_s = now_s + task.period_s
            while task.due_s <= now_s:
                self._send(task.can_id, task.data)
                task.due_s += task.period_s

    def due_s(self) -> float:
        return min(
            (task.due_s for task in self._periodic if task.due_s is not None),
            default=float("inf"),
        )


BLIND_POLL_S = 0.0005  # of a bus that has no descriptor to wait for


class CanLine(ABC):
    """The nodes' end of a bus.

    Attributes:
        poll_s: polling interval; None if a descriptor shows frames.
        bus_off: no frame is received or sent.
        n_dropped: frames that the host did not take.
        n_rejected: received frames that were not understood.
    """

    poll_s: float | None = None

    def __init__(self, where: str) -> None:
        self.where = where
        self.bus_off = False
        self.n_dropped = self.n_rejected = 0

    @abstractmethod
    def receive(self) -> list[tuple[int, bytes]]:
        """Received frames: identifier and data."""

    @abstractmethod
    def send(self, can_id: int, data: bytes) -> None:
        """Put a frame on the bus."""

    def send_error(self, classes: int) -> None:  # noqa: B027 - some report on request
        """Report an error to the hosts, as their own controllers would."""

    def flush(self) -> None:  # noqa: B027 - on most nothing waits
        """Send the waiting frames."""

    @abstractmethod
    def readers(self) -> list[int]:
        """Descriptors to wait for until frames arrive."""

    def writers(self) -> list[int]:
        return []

    @abstractmethod
    def close(self) -> None:
        """Take it away."""


class LibraryLine(CanLine):
    """A bus of python-can: `virtual`, `udp_multicast`, `socketcan`.

    Frames that its socket does not take are dropped.

    Raises:
        OSError: it cannot be opened.
    """

    def __init__(self, interface: str, channel: str) -> None:
        super().__init__(f"{interface}:{channel}")
        try:
            self._bus = can.Bus(channel, interface, ignore_config=True)
        except (can.CanError, ValueError, ImportError) as error:
            raise OSError(f"cannot open the bus {self.where}: {error}") from error
        try:
            self._descriptors = [self._bus.fileno()]
        except NotImplementedError:
            self._descriptors, self.poll_s = [], BLIND_POLL_S

    def receive(self) -> list[tuple[int, bytes]]:
        frames = []
        with contextlib.suppress(can.CanError):
            while (message := self._bus.recv(0)) is not None:
                plain = not (
                    message.is_error_frame
                    or message.is_extended_id
                    or message.is_remote_frame
                )
                if plain and not self.bus_off:
                    frames.append((message.arbitration_id, bytes(message.data)))
        return frames

    def send(self, can_id: int, data: bytes) -> None:
        if not self.bus_off:
            self._put(
                can.Message(arbitration_id=can_id, data=data, is_extended_id=False)
            )

    def send_error(self, classes: int) -> None:
        self._put(
            can.Message(
                arbitration_id=classes,
                is_error_frame=True,
                is_extended_id=False,
                data=bytes(8),
            )
        )

    def readers(self) -> list[int]:
        return self._descriptors

    def close(self) -> None:
        self._bus.shutdown()

    def _put(self, message: can.Message) -> None:
        try:
            self._bus.send(message)
        except (can.CanError, OSError):
            self.n_dropped += 1
