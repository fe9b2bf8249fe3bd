"""What has been dealt with and is answered as soon as the disk has it, in order.

An acknowledgement to a board covers all earlier edges, so nothing overtakes a point
that is still on its way to the disk.
"""

from collections import deque
from collections.abc import Callable

from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.points.request_queue import Request
from traverse.daemon.store.records import PendingWrite

Outcome = object | CaptureRefusedError


class Answers:
    """Requests with what has come of them.

    Args:
        tell: called with each request and what came of it, when it may be told: a
            point, another result, or why there is none.
    """

    def __init__(self, tell: Callable[[Request, Outcome], None]) -> None:
        self._tell = tell
        self._waiting: deque[tuple[Request, Outcome]] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, request: Request, outcome: Outcome) -> None:
        """Report the result of a request; of a `PendingWrite`, what becomes of it."""
        self._waiting.append((request, outcome))
        if isinstance(outcome, PendingWrite):
            outcome.on_settled(self._tell_all)
        else:
            self._tell_all()

    def _tell_all(self) -> None:
        while self._waiting:
            request, outcome = self._waiting[0]
            if isinstance(outcome, PendingWrite):
                if not outcome.is_settled:
                    return
                outcome = _settled(outcome)
            self._waiting.popleft()
            self._tell(request, outcome)


def _settled(keeping: PendingWrite) -> Outcome:
    trouble = keeping.trouble
    if trouble is None:
        return keeping.point
    return CaptureRefusedError(trouble.text, trouble.remedy, "outbox.failed")
