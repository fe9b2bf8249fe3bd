"""Alarms of a board: of its encoders, and of its own losses."""

from traverse.simulator.devices.latch_board import wire
from traverse.simulator.devices.latch_board.tick_counter import TickCounter
from traverse.simulator.scenario.signals import AlarmChange

BOARD_ITSELF = 0xFF
FRAMES_DROPPED, EDGES_LOST = 6, 7
DROPPING_ENDS_S = 1.0  # so long without a loss, and the alarm is cleared


class Alarms:
    """Writes alarms and remembers which of the board's own are raised.

    Attributes:
        tx_dropped: Samples that the line did not take.
    """

    def __init__(self, ticks: TickCounter) -> None:
        self.tx_dropped = 0
        self._ticks = ticks
        self._next_seq = 0
        self._dropped_at_s: float | None = None
        self._losing_edges = False

    def of_encoder(self, change: AlarmChange) -> bytes:
        """An encoder begins or ends to complain."""
        at_s = change.time_s
        return self._write(
            at_s, change.channel, change.state, change.code, change.value
        )

    def drop(self, n_dropped: int, now_s: float) -> list[bytes]:
        """Count samples that were dropped; raise the alarm at the first."""
        self.tx_dropped += n_dropped
        begins = self._dropped_at_s is None
        self._dropped_at_s = now_s
        return [self._of_frames(1, now_s)] if begins else []

    def next_due_s(self) -> float:
        """When dropping counts as over; infinity if nothing is dropped."""
        if self._dropped_at_s is None:
            return float("inf")
        return self._dropped_at_s + DROPPING_ENDS_S

    def end_dropping(self, now_s: float) -> list[bytes]:
        """Clear the alarm."""
        self._dropped_at_s = None
        return [self._of_frames(0, now_s)]

    def lose_edge(self, n_lost: int, now_s: float) -> bytes:
        """Report that there was no room for an edge."""
        self._losing_edges = True
        return self._write(now_s, BOARD_ITSELF, 1, EDGES_LOST, n_lost)

    def end_losing_edges(self, n_lost: int, now_s: float) -> list[bytes]:
        """Clear the alarm, if it is raised: no edge waits any more."""
        if not self._losing_edges:
            return []
        self._losing_edges = False
        return [self._write(now_s, BOARD_ITSELF, 0, EDGES_LOST, n_lost)]

    def _of_frames(self, state: int, now_s: float) -> bytes:
        return self._write(now_s, BOARD_ITSELF, state, FRAMES_DROPPED, self.tx_dropped)

    def _write(
        self, now_s: float, channel: int, state: int, code: int, value: int
    ) -> bytes:
        seq, self._next_seq = self._next_seq, self._next_seq + 1
        ticks = self._ticks.shown(self._ticks.at(now_s))
        shown = min(value, 0x7FFFFFFF)
        return wire.alarm(channel, state, code, seq=seq, ticks=ticks, value=shown)
