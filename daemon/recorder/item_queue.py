"""The one queue from the event loop to the recorder thread: bounded, values only."""

import threading
from collections import deque
from dataclasses import dataclass
from typing import Any, Literal

from traverse.drivers.base.values import CountSamples

Kind = Literal[
    "delivered",
    "asked",
    "passed",
    "related",
    "published",
    "state",
    "files",
    "gap",
    "keep",
    "job",
]

MAX_ITEMS = 20_000
MOST_BYTES = 64 << 20
ITEM_BYTES = 400  # of anything but samples, roughly
WAIT_S = 1.0
WARM_UP_NS = 6_000_000_000
"""Readings, poses and motion are remembered for less: who continues from a state has to
be given so much of the stream before all points are as they were.
"""


@dataclass(frozen=True, slots=True)
class RecorderItem:
    """One thing to record.

    Attributes:
        at_ns: host monotonic.
        what: of its kind: a delivery's kind, a command's name, a message's topic.
        value: of its kind.
    """

    kind: Kind
    at_ns: int
    what: str = ""
    value: Any = None

    @property
    def n_bytes(self) -> int:
        """How much memory it keeps, roughly."""
        if isinstance(self.value, CountSamples):
            n, channels = self.value.counts.shape
            return int(ITEM_BYTES + n * (25 + 9 * channels))
        return ITEM_BYTES


class RecorderQueue:
    """Takes items from the loop without waiting, and gives them to the thread.

    Attributes:
        dropped: items for which there was no room.
    """

    def __init__(
        self, most_items: int = MAX_ITEMS, most_bytes: int = MOST_BYTES
    ) -> None:
        self._most_items, self._most_bytes = most_items, most_bytes
        self._lock = threading.Lock()
        self._items: deque[RecorderItem] = deque()
        self._n_bytes = 0
        self._wake = threading.Event()
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: RecorderItem) -> bool:
        """Hand over; False where there was no room. What is no step always has room."""
        size = item.n_bytes
        with self._lock:
            is_full = (
                len(self._items) >= self._most_items
                or self._n_bytes + size > self._most_bytes
            )
            if is_full and item.kind not in ("job", "keep"):
                self.dropped += 1
                return False
            self._items.append(item)
            self._n_bytes += size
        return True

    def wake(self) -> None:
        """Wake the thread."""
        self._wake.set()

    def take(self, wait_s: float = WAIT_S) -> list[RecorderItem]:
        """All that waits, after a while, or when woken; perhaps nothing."""
        self._wake.wait(min(wait_s, WAIT_S))
        self._wake.clear()
        with self._lock:
            taken = list(self._items)
            self._items.clear()
            self._n_bytes = 0
        return taken
