"""Edges and commands in the order in which they came, until they have been dealt with.

Where a device latches all joints, that is at once. Else the readings after the instant
are waited for; what came later waits too, so that points keep their order and no edge
is acknowledged before an earlier one.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from daemon.device import Device
from drivers.values import LatchedCounts
from protocol.messages import Point
from protocol.messages.point import Trigger

MAX_PENDING = 256


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """An edge, or a command to take a point.

    Attributes:
        instant_ns: host monotonic time of it.
        received_ns: when the daemon got it.
        deadline_ns: until when it may wait.
        device, latch: the edge; None for a command.
        trigger: what it captures with; None for an edge that captures nothing.
        answer: who waits for the point of a command.
    """

    instant_ns: int
    received_ns: int
    deadline_ns: int
    trigger: Trigger | None
    device: Device | None = None
    latch: LatchedCounts | None = None
    answer: asyncio.Future[Point] | None = None

    @property
    def captures(self) -> bool:
        """Whether it asks for a point."""
        return self.trigger is not None and (self.latch is None or self.latch.active)


class PendingPoints:
    """Deals with requests one after the other.

    Args:
        try_one: deals with a request; False while it has to wait. With the second
            argument True it must not wait any more.
    """

    def __init__(self, try_one: Callable[[Request, bool], bool]) -> None:
        self._try_one = try_one
        self._requests: deque[Request] = deque()

    def __len__(self) -> int:
        return len(self._requests)

    def add(self, request: Request) -> None:
        """Take a request, and deal with all that can be dealt with."""
        self._requests.append(request)
        self.settle()

    def settle(self, now_ns: int | None = None) -> None:
        """Deal with what can be dealt with, or has waited long enough by some time."""
        while self._requests:
            request = self._requests[0]
            is_last_chance = len(self._requests) > MAX_PENDING or (
                now_ns is not None and now_ns >= request.deadline_ns
            )
            if not self._try_one(request, is_last_chance):
                break
            self._requests.popleft()
