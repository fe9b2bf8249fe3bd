"""Edges and commands in the order of arrival, until they have been processed.

Where a device latches all joints, that is at once. Else the readings after the instant
are awaited, or the samples of a mean; later requests wait too, so that points keep
their order and no edge is acknowledged before an earlier one.
"""

from collections import deque
from collections.abc import Callable, Iterator

from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.points.observation import Observation
from traverse.daemon.points.requests import Request, observation_of
from traverse.daemon.store.records import PendingPoint

MAX_PENDING = 256
MAX_WAITING_DURING_MEAN = (
    12  # behind a mean: a board keeps 16 edges that are not acknowledged
)


class RequestQueue:
    """Keep requests in order."""

    def __init__(self) -> None:
        self._requests: deque[Request] = deque()

    def __len__(self) -> int:
        return len(self._requests)

    @property
    def is_crowded(self) -> bool:
        """Whether so many wait that a mean must not be awaited."""
        return len(self._requests) > MAX_WAITING_DURING_MEAN

    @property
    def first(self) -> Request:
        return self._requests[0]

    @property
    def observations(self) -> Iterator[Observation]:
        return filter(None, map(observation_of, self._requests))

    def add(self, request: Request) -> None:
        self._requests.append(request)

    def remove_first(self) -> None:
        self._requests.popleft()

    def must_not_wait(self, now_ns: int | None) -> bool:
        """Whether the first has waited long enough, or there is no more room."""
        is_late = now_ns is not None and now_ns >= self.first.deadline_ns
        return is_late or len(self._requests) > MAX_PENDING


Outcome = object | CaptureRefusedError


class OrderedReplies:
    """Requests with their results.

    Args:
        report: called with each request and its result, in order: a point, another
            result, or the reason for none.
    """

    def __init__(self, report: Callable[[Request, Outcome], None]) -> None:
        self._report = report
        self._waiting: deque[tuple[Request, Outcome]] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, request: Request, outcome: Outcome) -> None:
        """Report the result of a request; of a `PendingPoint`, once it is known."""
        self._waiting.append((request, outcome))
        if isinstance(outcome, PendingPoint):
            outcome.on_settled(self._report_settled)
        else:
            self._report_settled()

    def _report_settled(self) -> None:
        while self._waiting:
            request, outcome = self._waiting[0]
            if isinstance(outcome, PendingPoint):
                if not outcome.is_settled:
                    return
                trouble, outcome = outcome.trouble, outcome.point
                if trouble is not None:
                    outcome = CaptureRefusedError(
                        trouble.text, trouble.remedy, "outbox.failed"
                    )
            self._waiting.popleft()
            self._report(request, outcome)
