"""The bounded queue from the event loop to the recorder thread."""

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
"""Bound on the history of readings, poses and motion.

A replay from a state needs so much of the stream before its points agree.
"""


@dataclass(frozen=True, slots=True)
class RecorderItem:
    """One thing to record.

    Attributes:
        at_ns: host monotonic.
        name: kind of delivery, name of a command, or topic of a message.
    """

    kind: Kind
    at_ns: int
    name: str = ""
    value: Any = None

    @property
    def n_bytes(self) -> int:
        if isinstance(self.value, CountSamples):
            n, channels = self.value.counts.shape
            return int(ITEM_BYTES + n * (25 + 9 * channels))
        return ITEM_BYTES


class RecorderQueue:
    """Takes items without waiting and hands them to the thread.

    Attributes:
        dropped: items refused for want of room.
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
        """Append an item; False if there is no room, except for control items."""
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
        self._wake.set()

    def take(self, wait_s: float = WAIT_S) -> list[RecorderItem]:
        """Wait for items and return them; perhaps none."""
        self._wake.wait(min(wait_s, WAIT_S))
        self._wake.clear()
        with self._lock:
            items = list(self._items)
            self._items.clear()
            self._n_bytes = 0
        return items
