"""Points on their way to the disk: from a number to a promise kept, or taken back."""

from collections import deque
from collections.abc import Callable

from traverse.daemon.points.session import Session
from traverse.daemon.store.records import StorageError
from traverse.protocol.messages import Point


class PendingWrite:
    """A point that has a number, and is not known to be on the disk yet.

    Attributes:
        point: a capture or a retraction.
        is_settled: it is on the disk, or it is not and never will be.
        trouble: why it is not.
    """

    def __init__(self, point: Point) -> None:
        self.point = point
        self.is_settled = False
        self.trouble: StorageError | None = None
        self._acts: list[Callable[[], object]] = []

    def settle(self, trouble: StorageError | None = None) -> None:
        """It is on the disk now; with a trouble, it never will be."""
        self.trouble = trouble
        self.is_settled = True
        for act in self._acts:
            act()

    def on_settled(self, act: Callable[[], object]) -> None:
        """Have something called as soon as it is; at once if it is already."""
        if self.is_settled:
            act()
        else:
            self._acts.append(act)


class PendingWrites:
    """Keepings in the order of their numbers."""

    def __init__(self) -> None:
        self._keepings: deque[tuple[Session, PendingWrite]] = deque()

    def __len__(self) -> int:
        return len(self._keepings)

    def add(self, session: Session, point: Point) -> PendingWrite:
        """A point of a session is on its way."""
        keeping = PendingWrite(point)
        self._keepings.append((session, keeping))
        return keeping

    def keep(self) -> Point:
        """The first is on the disk: whoever waits for it hears that. Gives it."""
        _, keeping = self._keepings.popleft()
        keeping.settle()
        return keeping.point

    def fail(self, trouble: StorageError) -> None:
        """None will be: first their numbers become free again, then all hear of it."""
        failed = list(self._keepings)
        self._keepings.clear()
        for session, keeping in reversed(failed):
            session.roll_back(keeping.point)
        for _, keeping in failed:
            keeping.settle(trouble)
