"""The last seconds in memory: with them every recording begins.

Their bytes are put one behind the other. Kept one by one, for some seconds each,
between all that is allocated and freed meanwhile, they would leave a heap of holes.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from traverse.daemon.recorder.snapshot import WARM_UP_NS
from traverse.recording.run_writer import Entry

MOST_BYTES = 32 << 20


@dataclass(slots=True)
class _Part:
    """What came since a state: the bytes of all messages, and where each ends."""

    begun_ns: int
    content: bytearray = field(default_factory=bytearray)
    ends: list[tuple[str, int, int]] = field(default_factory=list)

    def add(self, entry: Entry) -> None:
        self.content += entry.content
        self.ends.append((entry.topic, entry.log_ns, len(self.content)))

    def __iter__(self) -> Iterator[Entry]:
        begin = 0
        for topic, log_ns, end in self.ends:
            yield Entry(topic, log_ns, bytes(self.content[begin:end]))
            begin = end


class PreTriggerBuffer:
    """Keeps messages since the last state that is old enough to be gone on from."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._parts: deque[_Part] = deque()
        self._n_bytes = 0

    def begin_segment(self, at_ns: int) -> None:
        """The next message is a state."""
        parts = self._parts
        parts.append(_Part(at_ns))
        while len(parts) > 1 and parts[1].begun_ns <= at_ns - WARM_UP_NS:
            self._drop_oldest()

    def add(self, entry: Entry) -> None:
        """Remember a message; those of scans and before the first state are not."""
        if entry.topic == "cloud" or not self._parts:
            return
        self._parts[-1].add(entry)
        self._n_bytes += len(entry.content)
        while self._n_bytes > self._most_bytes and self._parts:
            self._drop_oldest()

    def clear(self) -> None:
        """Forget all: something is missing, or the files are others."""
        self._parts.clear()
        self._n_bytes = 0

    def __iter__(self) -> Iterator[Entry]:
        for part in self._parts:
            yield from part

    def __bool__(self) -> bool:
        return bool(self._parts)

    def _drop_oldest(self) -> None:
        self._n_bytes -= len(self._parts.popleft().content)
