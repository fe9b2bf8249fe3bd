"""Edges and commands in the order of arrival, until they have been processed.

Where a device latches all joints, that is at once. Else the readings after the instant
are awaited, or the samples of a mean; later ones wait too, so that points keep
their order and no edge is acknowledged before an earlier one.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from traverse.daemon.acquisition.device import Device
from traverse.daemon.config.schema import Action
from traverse.daemon.current_request import CURRENT_REQUEST
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.points.averaging import SampleAverage
from traverse.daemon.points.buttons import Press
from traverse.daemon.points.capture import PointMeasurement
from traverse.daemon.points.compensation import RetractDetector
from traverse.daemon.store.records import PendingPoint
from traverse.drivers.base.values import LatchedCounts
from traverse.protocol.messages.point import Trigger

CAPTURING: frozenset[Action] = frozenset(("point", "average"))
MAX_PENDING = 256
MAX_WAITING_DURING_MEAN = (
    12  # behind a mean: a board keeps 16 edges that are not acknowledged
)


@dataclass(slots=True, eq=False)
class PointRequest:
    """An edge, or a command.

    Attributes:
        instant_ns: host monotonic time of it.
        received_ns: when the daemon got it.
        deadline_ns: until when it may wait for readings.
        trigger: what it captures with; None for what captures nothing.
        device: whose edge it is; None for a command.
        latch: what a device latched at that instant.
        press: which press of a button the edge is; None for releases and switches.
        ends: the hold that ends with this release.
        answer: receives the result of a command.
        act: what a command does that takes no point.
        average: the samples of a mean.
        mean: of these samples, as soon as they are complete.
        pull: watches where the probe is pulled to.
        is_evaluated: nothing more is to be seen of its instant.
        seen: what is known of the arm at the instant, as soon as it is.
        requested_by: the request of the command; None for an edge.
    """

    instant_ns: int
    received_ns: int
    deadline_ns: int
    trigger: Trigger | None = None
    device: Device | None = None
    latch: LatchedCounts | None = None
    press: Press | None = None
    ends: Press | None = None
    answer: asyncio.Future[Any] | None = None
    act: Callable[[], object] | None = None
    average: SampleAverage | None = None
    mean: PointMeasurement | None = None
    pull: RetractDetector | None = None
    seen: PointMeasurement | None = None
    is_evaluated: bool = False
    requested_by: str | None = field(default_factory=CURRENT_REQUEST.get)

    @property
    def captures(self) -> bool:
        """Whether it requests a point."""
        if self.press is not None and self.press.action is not None:
            return self.press.action in CAPTURING
        return self.may_capture

    @property
    def may_capture(self) -> bool:
        """Whether it may turn out to request one."""
        if self.trigger is None or self.act is not None:
            return False
        return self.device is None or self.latch is None or self.latch.active

    def resolve(self, outcome: object) -> None:
        """Report the result to the requester, if it still waits."""
        if self.answer is None or self.answer.done():
            return
        if isinstance(outcome, Exception):
            self.answer.set_exception(outcome)
        else:
            self.answer.set_result(outcome)


@dataclass(eq=False)
class PointRequestQueue:
    """Deals with requests one after the other.

    Args:
        look: finds out what a request that has not seen the arm yet can see of it.
        try_one: deals with a request; False while it has to wait. With the second
            argument True it must not wait any more.

    Attributes:
        some: set while there are requests that wait.
    """

    look: Callable[[PointRequest], None]
    try_one: Callable[[PointRequest, bool], bool]

    def __post_init__(self) -> None:
        self._requests: deque[PointRequest] = deque()
        self.some = asyncio.Event()

    def __len__(self) -> int:
        return len(self._requests)

    @property
    def is_crowded(self) -> bool:
        """So many wait that a mean must not be waited for."""
        return len(self._requests) > MAX_WAITING_DURING_MEAN

    def add(self, request: PointRequest) -> None:
        """Take a request, and deal with all that can be dealt with."""
        self._requests.append(request)
        self.settle()

    def look_again(self) -> None:
        """Use another arm: what waits was requested after the change."""
        for request in self._requests:
            if request.may_capture:
                request.seen = None
                request.is_evaluated = False
                self.look(request)

    def settle(self, now_ns: int | None = None) -> None:
        """Deal with what can be dealt with, or has waited long enough by some time."""
        for request in self._requests:
            if request.may_capture and not request.is_evaluated:
                self.look(request)
        while self._requests:
            request = self._requests[0]
            is_last_chance = len(self._requests) > MAX_PENDING or (
                now_ns is not None and now_ns >= request.deadline_ns
            )
            if not self.try_one(request, is_last_chance):
                break
            self._requests.popleft()
        if self._requests:
            self.some.set()
        else:
            self.some.clear()


Outcome = object | CaptureRefusedError


class OrderedReplies:
    """Requests with their results.

    Args:
        tell: called with each request and its result, when it may be reported: a
            point, another result, or why there is none.
    """

    def __init__(self, tell: Callable[[PointRequest, Outcome], None]) -> None:
        self._tell = tell
        self._waiting: deque[tuple[PointRequest, Outcome]] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, request: PointRequest, outcome: Outcome) -> None:
        """Report the result of a request; of a `PendingPoint`, what becomes of it."""
        self._waiting.append((request, outcome))
        if isinstance(outcome, PendingPoint):
            outcome.on_settled(self._tell_all)
        else:
            self._tell_all()

    def _tell_all(self) -> None:
        while self._waiting:
            request, outcome = self._waiting[0]
            if isinstance(outcome, PendingPoint):
                if not outcome.is_settled:
                    return
                trouble, outcome = outcome.trouble, outcome.point
                if trouble is not None:
                    told = trouble.text, trouble.remedy, "outbox.failed"
                    outcome = CaptureRefusedError(*told)
            self._waiting.popleft()
            self._tell(request, outcome)
