"""Points that are being written: they succeed, or fail and are rolled back."""

from collections import deque
from collections.abc import Callable

from traverse.daemon.store.records import StorageError
from traverse.protocol.messages import Point


class PendingWrite:
    """A point that has a number, and is not known to be on the disk yet.

    Attributes:
        point: a capture or a retraction.
        is_settled: it is on the disk, or it is not and never will be.
        trouble: why it is not.
        roll_back: called if the write fails, before anybody is notified of that.
    """

    def __init__(self, point: Point) -> None:
        self.point = point
        self.is_settled = False
        self.trouble: StorageError | None = None
        self.roll_back: Callable[[], object] = lambda: None
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
    """Writes in the order of their points' numbers."""

    def __init__(self) -> None:
        self._writes: deque[PendingWrite] = deque()

    def __len__(self) -> int:
        return len(self._writes)

    def add(self, point: Point) -> PendingWrite:
        """Add a point that is being written."""
        write = PendingWrite(point)
        self._writes.append(write)
        return write

    def keep(self) -> Point:
        """Settle the first, which is on the disk; return its point."""
        write = self._writes.popleft()
        write.settle()
        return write.point

    def fail(self, trouble: StorageError) -> None:
        """Fail all: roll back from the newest to the oldest, only then notify."""
        failed = list(self._writes)
        self._writes.clear()
        for write in reversed(failed):
            write.roll_back()
        for write in failed:
            write.settle(trouble)
