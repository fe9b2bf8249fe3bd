"""Edges of the inputs: kept and sent again until the host has them."""

from collections import deque
from dataclasses import dataclass

from traverse.simulator.devices.latch_board import wire
from traverse.simulator.scenario.signals import LatchedEdge

AGAIN_AFTER_S = 0.050
MOST_WAITING = 16


@dataclass(slots=True)
class _Waiting:
    seq: int
    data: bytes
    sent_s: float


class EdgeQueue:
    """The edges that were sent and not yet acknowledged, at most 16."""

    def __init__(self) -> None:
        self.next_seq = 0
        self.n_lost = 0
        self._waiting: deque[_Waiting] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def back(self) -> int:
        """Next number less that of the oldest waiting edge; 0 if none waits."""
        return min(255, self.next_seq - self._waiting[0].seq) if self._waiting else 0

    def report(self, edge: LatchedEdge, now_s: float) -> bytes | None:
        """Store an edge and return its frame; None if there is no room."""
        seq, self.next_seq = self.next_seq, self.next_seq + 1
        if len(self._waiting) >= MOST_WAITING:
            self.n_lost += 1
            return None
        data = wire.edge(
            edge.input_number,
            edge.level,
            edge.inputs,
            seq=seq & 0xFFFFFFFF,
            ticks=edge.ticks,
            counts=edge.counts,
            status=edge.status,
        )
        self._waiting.append(_Waiting(seq, data, now_s))
        return data

    def acknowledge(self, seq_shown: int) -> None:
        """Drop every edge up to and including the one with these 32 bits."""
        while self._waiting:
            age = (seq_shown - self._waiting[0].seq) & 0xFFFFFFFF
            if age >= 0x80000000:
                break
            self._waiting.popleft()

    def forget(self) -> None:
        """Drop all of them."""
        self._waiting.clear()

    def next_due_s(self) -> float:
        """When one is to be sent again; infinity if none waits."""
        due_s = min((entry.sent_s for entry in self._waiting), default=float("inf"))
        return due_s + AGAIN_AFTER_S

    def due_again(self, now_s: float) -> list[bytes]:
        """Return those to be sent again now, oldest first."""
        due = [e for e in self._waiting if e.sent_s + AGAIN_AFTER_S <= now_s]
        for entry in due:
            entry.sent_s = now_s
        return [entry.data for entry in due]
