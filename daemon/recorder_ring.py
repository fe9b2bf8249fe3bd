"""The last seconds in memory: with them every recording begins."""

from collections import deque
from collections.abc import Iterator

from daemon.recorder_state import WARM_NS
from recording.run_writer import Entry

MOST_BYTES = 32 << 20


class Ring:
    """Keeps messages since the last state that is old enough to be gone on from."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._parts: deque[tuple[int, list[Entry]]] = deque()
        self._n_bytes = 0

    def begin_part(self, at_ns: int) -> None:
        """The next message is a state."""
        parts = self._parts
        parts.append((at_ns, []))
        while len(parts) > 1 and parts[1][0] <= at_ns - WARM_NS:
            self._drop_oldest()

    def add(self, entry: Entry) -> None:
        """Remember a message; those of scans and before the first state are not."""
        if entry.topic == "cloud" or not self._parts:
            return
        self._parts[-1][1].append(entry)
        self._n_bytes += len(entry.content)
        while self._n_bytes > self._most_bytes and self._parts:
            self._drop_oldest()

    def clear(self) -> None:
        """Forget all: something is missing, or the files are others."""
        self._parts.clear()
        self._n_bytes = 0

    def __iter__(self) -> Iterator[Entry]:
        for _, entries in self._parts:
            yield from entries

    def __bool__(self) -> bool:
        return bool(self._parts)

    def _drop_oldest(self) -> None:
        _, entries = self._parts.popleft()
        self._n_bytes -= sum(len(entry.content) for entry in entries)
