"""A latch board that has said who it is: what it says from then on is taken here."""

from traverse.drivers.base.values import DeviceError
from traverse.drivers.latch_board.edge_sequence import EdgeSequencer
from traverse.drivers.latch_board.latches import BoardLatches
from traverse.drivers.latch_board.line import PartialReads
from traverse.drivers.latch_board.report_sink import BoardReports
from traverse.drivers.latch_board.samples import BoardSamples
from traverse.drivers.timing.device_clock import DeviceClock
from traverse.protocol import latch_board as wire


class LatchBoardSession:
    """One connection to a board.

    Args:
        path: of its port, for people.
        tick_rate_hz: of its counter.
        edges: their order, which outlives the connection.
        reports: where everything goes.

    Attributes:
        samples: the timed ones.
        latches: edges, and what is latched on request.
        n_channels: as HELLO told.
    """

    def __init__(
        self, path: str, tick_rate_hz: int, edges: EdgeSequencer, reports: BoardReports
    ) -> None:
        self._path, self._edges = path, edges
        self._counters = reports.counters
        self._clock = DeviceClock(tick_rate_hz)
        self.n_channels = reports.n_channels
        self.samples = BoardSamples(self._clock, reports)
        self.latches = BoardLatches(self._clock, edges, reports)

    def take(
        self, message: wire.Message, received_ns: int, earlier: PartialReads = ()
    ) -> None:
        """Take what is about samples, edges and time; all else is not for here.

        Raises:
            DeviceError: the board has forgotten its stream.
        """
        match message:
            case wire.SampleBlock():
                self.samples.take(message, received_ns, earlier)
            case wire.Edge():
                self.latches.take_edge(message, received_ns)
            case wire.Heartbeat():
                self._take_heartbeat(message, received_ns)
            case _:
                pass

    def _take_heartbeat(self, heartbeat: wire.Heartbeat, received_ns: int) -> None:
        clock, counters = self._clock, self._counters
        if self.samples.streaming:
            if not heartbeat.streaming:
                raise DeviceError(
                    f"the board on {self._path} has stopped its stream by itself",
                    "check its power: it has probably been restarted",
                )
            self.samples.reach(heartbeat.next_sample_seq)
        clock.update(clock.unwrap_one(heartbeat.ticks), received_ns)
        self._edges.begin_at(heartbeat.next_edge_seq - heartbeat.edges_back)
        counters["board_tx_dropped"] = heartbeat.tx_dropped
        counters["board_rx_rejected"] = heartbeat.rx_rejected
        counters["clock_steps"] = clock.steps
