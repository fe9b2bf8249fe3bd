"""Driver of a latching controller board on a serial line (docs/serial-protocol.md)."""

import time
from collections import deque
from collections.abc import Callable, Sized

import numpy as np
from pydantic import Field

from drivers.board_hello import alarm_of, check_hello, identity_of
from drivers.board_line import Answer, BoardLine
from drivers.crossing import Crossing
from drivers.driver import Driver
from drivers.edge_order import EdgeOrder
from drivers.options import DriverOptions
from drivers.serial_port import SerialPort
from drivers.stream_sequence import StreamSequence
from drivers.tick_clock import TickClock
from drivers.values import (
    STATUS_WARNING,
    CountSamples,
    DeviceError,
    DeviceRefusedError,
    DeviceTemperatures,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from protocol import latch_board as wire

ALL_INPUTS = 0xFF
HEARTBEAT_MS = 500
EDGES_HEARTBEAT_MS = 20  # of a board that never streams: nothing else tells its time
TEMPERATURE_MS = 2000
MAX_LATCHES = 16
# The board sends an edge again after 50 ms. So it is acknowledged in a quiet moment,
# not while its point is on its way, and several are at once.
QUIET_S = 0.003
OVERDUE_NS = 20_000_000
# On a fast stream a read takes what some milliseconds bring, since waking up costs
# more than a sample; no more than a quarter of what a pty holds.
FAST_STREAM_HZ = 400.0
GATHER_S = 0.005
GATHER_BYTES = 1000

# The maker's own bits of a status byte warn of something; what, nobody else knows.
_MAKERS = 0xF0
_STATUS = np.array(
    [s & ~_MAKERS | (STATUS_WARNING if s & _MAKERS else 0) for s in range(256)],
    dtype=np.uint8,
)


class LatchBoardOptions(DriverOptions):
    """What the table of a latch board may say."""

    port: str = Field(min_length=1)
    baud_rate: int = Field(default=1_000_000, ge=9600, le=12_000_000)
    debounce_us: int = Field(default=5000, ge=0, le=1_000_000)


class LatchBoard(Driver):
    """A board that latches all encoders of an arm at one instant.

    Args:
        device: id in the configuration.
        crossing: where deliveries go.
        port: path of the serial port.
        baud_rate: of the line.
        debounce_us: how long an input must hold its new level.
        monotonic_ns: the host's clock.
    """

    options = LatchBoardOptions

    def __init__(
        self,
        device: str,
        crossing: Crossing,
        *,
        port: str,
        baud_rate: int = 1_000_000,
        debounce_us: int = 5000,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(device, crossing, monotonic_ns)
        self._path = port
        self._baud_rate = baud_rate
        self._debounce_us = debounce_us
        # Written by the service, read by the thread: what is wanted of the board.
        self._rate_hz = 0.0
        self._streams_wanted = 0
        self._latches: deque[int] = deque()
        self._latch_token = 0
        self._edges = EdgeOrder()
        # The thread's own.
        self._port: SerialPort | None = None
        self._line: BoardLine | None = None
        self._boot_id: int | None = None
        self._n_channels: int | None = None  # until HELLO has told
        self._acknowledged: int | None = None
        self._acknowledged_ns = 0
        self._frames_before = 0
        self._streams_begun = 0
        self._stream = 0
        self._stream_request = 0
        self._sequence = StreamSequence()
        self._clock = TickClock(1_000_000)

    def request_stream(self, rate_hz: float) -> None:
        """Stream timed samples at ``rate_hz`` from now on; 0 stops the stream."""
        self._rate_hz = rate_hz
        self._streams_wanted += 1
        self._wake()

    def request_latch(self) -> int:
        """Latch once, now; the returned token comes back in `LatchedCounts`.

        Raises:
            DeviceError: too many requests are waiting already.
        """
        if len(self._latches) >= MAX_LATCHES:
            raise DeviceError(
                f"{MAX_LATCHES} latch requests wait for {self.device}", "ask less often"
            )
        self._latch_token += 1
        self._latches.append(self._latch_token)
        self._wake()
        return self._latch_token

    def acknowledge(self, token: int) -> None:
        """Have the board told soon that edges up to ``token`` have been dealt with."""
        self._edges.acknowledge(token)

    # -- in the reader thread -------------------------------------------------

    def _connect(self) -> None:
        self._port = SerialPort(self._path, self._baud_rate, self._wake_read)
        line = self._line = BoardLine(
            self._port, self._now_ns, self._dispatch, lambda: self._stopping
        )
        line.begin()
        first = self._boot_id is None
        self._n_channels = None
        self._stream_request = 0
        flags = wire.FORGET_EDGES if first else 0
        hello = line.ask("HELLO", lambda number: wire.hello_request(number, flags))
        if not isinstance(hello, wire.Hello):
            raise DeviceError(f"HELLO was answered by {hello}", "update the firmware")
        check_hello(hello, self._path)
        restarted = not first and hello.boot_id != self._boot_id
        self._latches.clear()  # whoever waited for them has given up
        self._clock = TickClock(hello.tick_rate_hz)
        heartbeat_ms = HEARTBEAT_MS if hello.channels else EDGES_HEARTBEAT_MS
        line.ask(
            "CONFIGURE",
            lambda number: wire.configure_request(
                number, ALL_INPUTS, heartbeat_ms, TEMPERATURE_MS, self._debounce_us
            ),
        )
        self._tell(DeviceUp(self.device, identity_of(hello), restarted))
        # Not earlier: if CONFIGURE fails, the next try has to tell of the restart.
        if restarted:
            self._edges, self._acknowledged = EdgeOrder(0), None
        self._boot_id = hello.boot_id
        self._n_channels = len(hello.channels)  # from now on edges are taken
        self._streams_begun = 0  # what was wanted is to be asked for again

    def _serve(self) -> None:
        line, broken = self._line, 0
        while line is not None and not self._stopping:
            self._carry_out_requests(line)
            if not line.wait(QUIET_S if self._owes_acknowledgement else 0.1):
                self._acknowledge(line)
            else:
                line.read(self._gather_s())
                self._report_broken(line.broken - broken)
                broken = line.broken
            self._counters["frames_received"] = self._frames_before + line.accepted
            self._report_counters()
            line.check_alive()

    @property
    def _owes_acknowledgement(self) -> bool:
        """Whether an edge has been delivered of which the board does not know it."""
        edges = self._edges
        return edges.are_open or edges.last_acknowledged != self._acknowledged

    def _gather_s(self) -> float:
        """How long to let samples come together."""
        if self._rate_hz <= FAST_STREAM_HZ:
            return 0.0
        bytes_s = self._rate_hz * wire.sample_frame_bytes(self._n_channels or 0)
        return min(GATHER_S, GATHER_BYTES / bytes_s)

    def _disconnect(self) -> None:
        if self._line is not None:
            self._counters["requests_repeated"] += self._line.repeated
            self._frames_before += self._line.accepted
            self._line = None
        if self._port is not None:
            self._port.close()
            self._port = None

    def _carry_out_requests(self, line: BoardLine) -> None:
        if self._now_ns() - self._acknowledged_ns > OVERDUE_NS:
            self._acknowledge(line)
        while self._latches:
            # Its answer is taken here and not when it is dispatched, so that a late
            # answer to an earlier try is not a second latch.
            answer = self._ask_or_fault(line, "LATCH", wire.latch_request)
            token = self._latches.popleft()
            if isinstance(answer, wire.Latched) and self._fits(answer.counts):
                self._deliver(answer, None, token, line.heard_ns)
        if self._streams_begun != (wanted := self._streams_wanted):
            self._streams_begun = wanted
            rate = round(self._rate_hz * 1000)
            self._stream_request = 0
            if rate:
                self._ask_or_fault(
                    line, "START", lambda number: wire.start_request(number, rate)
                )
            else:
                self._ask_or_fault(line, "STOP", wire.stop_request)

    def _acknowledge(self, line: BoardLine) -> None:
        """Tell the board of the edges that have been dealt with, if there are any."""
        self._acknowledged_ns = self._now_ns()
        if (done := self._edges.last_acknowledged) != self._acknowledged:
            self._acknowledged = done
            if done is not None:
                line.send(wire.edge_ack(done))

    def _ask_or_fault(
        self, line: BoardLine, name: str, frame: Callable[[int], bytes]
    ) -> Answer | None:
        """The answer; None where the board refused, which connecting cannot mend."""
        try:
            return line.ask(name, frame)
        except DeviceRefusedError as error:
            self._fault("request_refused", str(error), error.remedy)
            return None

    def _fits(self, counts: Sized) -> bool:
        """Whether a latch has the channels that HELLO told; else it is counted."""
        if len(counts) == self._n_channels:
            return True
        self._fault(
            "channels_changed",
            f"{len(counts)} channels in a frame of a board with {self._n_channels}",
            "update the board's firmware",
        )
        return False

    def _dispatch(self, message: wire.Message, received_ns: int) -> None:
        match message:
            case wire.Edge() | wire.Heartbeat() if self._n_channels is None:
                pass  # it may be of another board; both come again after HELLO
            case wire.SampleBlock():
                self._take_samples(message, received_ns)
            case wire.Edge():
                self._take_edge(message, received_ns)
            case wire.Reply(request_type=wire.START, result=0):
                # Its samples may stand in the same read: be ready for them now.
                self._stream += 1
                self._stream_request = message.request
                self._sequence = StreamSequence()
                rate_hz = message.value / 1000
                self._tell(StreamStarted(self.device, self._stream, rate_hz))
            case wire.Heartbeat():
                self._take_heartbeat(message, received_ns)
            case wire.Temperatures():
                self._crossing.put(DeviceTemperatures(self.device, message.values_c))
            case wire.Alarm():
                self._crossing.put(alarm_of(self.device, message))
            case _:
                pass  # answers are the line's business

    def _take_samples(self, block: wire.SampleBlock, received_ns: int) -> None:
        if block.request != self._stream_request:
            self._counters["samples_of_old_stream"] += len(block.seq)
            return
        if not self._fits(block.counts[0]):
            return
        seq, kept, lost, dropped = self._sequence.accept(block.seq)
        self._counters["samples_repeated"] += dropped
        self._report_lost(lost)
        if not len(seq):
            return
        rows = slice(None) if kept is None else kept
        ticks = self._clock.unwrap(block.ticks[rows])
        self._clock.update(int(ticks[-1]), received_ns)
        self._counters["samples_received"] += len(seq)
        self._crossing.put(
            CountSamples(
                self.device,
                self._stream,
                seq,
                ticks,
                received_ns,
                # A new smallest delay moves the clock gradually; none is below zero.
                np.minimum(self._clock.to_ns_array(ticks), received_ns),
                block.inputs[rows],
                block.counts[rows],
                _STATUS[block.status[rows]],
            )
        )

    def _take_edge(self, edge: wire.Edge, received_ns: int) -> None:
        if not self._clock.running or not self._fits(edge.counts):
            return  # the board sends it again; until then it has no time
        verdict, lost = self._edges.judge(edge.seq, received_ns)
        if lost:
            self._fault(
                "edges_lost",
                f"{lost} button or probe edges were lost on the board",
                "repeat the last points",
                lost,
            )
        if verdict == "acknowledged":
            self._acknowledged = None  # the board did not hear: say it again
        elif verdict == "next":
            # Noted before it is handed over: its acknowledgement may come at once.
            self._edges.delivered(edge.seq)
            if self._deliver(edge, edge.input, edge.seq, received_ns):
                self._counters["edges_received"] += 1
            else:
                self._edges.refused(edge.seq)

    def _deliver(
        self,
        latch: wire.Edge | wire.Latched,
        number: int | None,
        token: int,
        received_ns: int,
    ) -> bool:
        ticks = self._clock.unwrap_one(latch.ticks)
        self._clock.update(ticks, received_ns)
        return self._crossing.put(
            LatchedCounts(
                self.device,
                number,
                isinstance(latch, wire.Latched) or latch.level != 0,
                token,
                ticks,
                received_ns,
                min(self._clock.to_ns(ticks), received_ns),
                latch.counts,
                tuple(_STATUS[list(latch.status)].tolist()),
            )
        )

    def _take_heartbeat(self, heartbeat: wire.Heartbeat, received_ns: int) -> None:
        if self._stream_request and not heartbeat.streaming:
            raise DeviceError(
                f"the board on {self._path} has stopped its stream by itself",
                "check its power: it has probably been restarted",
            )
        if self._stream_request:
            self._report_lost(self._sequence.reach(heartbeat.next_sample_seq))
        self._clock.update(self._clock.unwrap_one(heartbeat.ticks), received_ns)
        self._edges.expect(heartbeat.next_edge_seq - heartbeat.edges_back)
        self._counters["board_tx_dropped"] = heartbeat.tx_dropped
        self._counters["board_rx_rejected"] = heartbeat.rx_rejected
        self._counters["clock_steps"] = self._clock.steps

    def _report_lost(self, lost: int) -> None:
        if lost:
            self._fault(
                "samples_lost",
                f"{lost} samples lost between board and host",
                "lower the rate, or use a faster line",
                lost,
            )

    def _report_broken(self, broken: int) -> None:
        if broken:
            self._fault(
                "frames_rejected",
                f"{broken} broken frames on {self._path}",
                "check cable, shielding and baud rate",
                broken,
            )
