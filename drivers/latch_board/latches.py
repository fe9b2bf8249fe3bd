"""What a latch board latches one at a time: edges of its inputs, and on request."""

from traverse.drivers.base.values import LatchedCounts
from traverse.drivers.latch_board.edge_sequence import EdgeSequencer
from traverse.drivers.latch_board.report_sink import BoardReports
from traverse.drivers.latch_board.samples import STATUS
from traverse.drivers.timing.device_clock import DeviceClock
from traverse.protocol import latch_board as wire

_STATUS = STATUS.tobytes()


class BoardLatches:
    """Latches of one connection.

    Args:
        clock: of the board.
        edges: their order, which outlives the connection.
        reports: where latches and faults go.
    """

    def __init__(
        self, clock: DeviceClock, edges: EdgeSequencer, reports: BoardReports
    ) -> None:
        self._clock, self._edges, self._reports = clock, edges, reports

    def take_answer(self, answer: wire.Latched, token: int, received_ns: int) -> None:
        """Hand over what was latched on request."""
        if self._reports.fits(answer.counts):
            self._deliver(answer, None, token, received_ns)

    def take_edge(self, edge: wire.Edge, received_ns: int) -> None:
        """Hand over an edge, if it is its turn."""
        if not self._clock.running:
            return  # the board sends it again; until then it has no time
        if not self._reports.fits(edge.counts):
            return
        verdict, lost = self._edges.classify(edge.seq, received_ns)
        if lost:
            self._reports.fault(
                "edges_lost",
                f"{lost} button or probe edges were lost on the board",
                "repeat the last points",
                lost,
            )
        if verdict != "next":
            return
        # Noted before it is handed over: its acknowledgement may come at once.
        self._edges.mark_delivered(edge.seq)
        if self._deliver(edge, edge.input, edge.seq, received_ns):
            self._reports.counters["edges_received"] += 1
        else:
            self._edges.mark_refused(edge.seq)

    def _deliver(
        self,
        latch: wire.Edge | wire.Latched,
        number: int | None,
        token: int,
        received_ns: int,
    ) -> bool:
        ticks = self._clock.unwrap_one(latch.ticks)
        self._clock.update(ticks, received_ns)
        return self._reports.put(
            LatchedCounts(
                self._reports.device,
                number,
                isinstance(latch, wire.Latched) or latch.level != 0,
                token,
                ticks,
                received_ns,
                min(self._clock.to_ns(ticks), received_ns),
                latch.counts,
                tuple(bytes(latch.status).translate(_STATUS)),
            )
        )
