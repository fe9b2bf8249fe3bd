"""Driver of a latching controller board on a serial line (docs/serial-protocol.md)."""

from collections import deque
from collections.abc import Callable
from statistics import median_high

from pydantic import Field

from traverse.drivers.base.driver import Driver, DriverOptions
from traverse.drivers.base.values import (
    CountSamples,
    DeviceError,
    DeviceRefusedError,
    DeviceTemperatures,
    DeviceUp,
    LatchedCounts,
)
from traverse.drivers.io.serial_port import SerialPort
from traverse.drivers.latch_board.identification import (
    board_identity,
    check_identification,
    device_alarm,
)
from traverse.drivers.latch_board.line import LatchBoardLine, PartialReads, Response
from traverse.drivers.latch_board.sequences import EdgeSequencer
from traverse.drivers.latch_board.session import LatchBoardSession
from traverse.drivers.timing.clock_report import ClockReporter
from traverse.drivers.timing.device_clock import DeviceClock
from traverse.protocol.latch_board import messages as wire


class LatchBoardOptions(DriverOptions):
    """Options of the driver `latch-board`.

    Attributes:
        port: path of the serial port.
        debounce_us: how long an input must hold its new level.
    """

    port: str = Field(min_length=1)
    baud_rate: int = Field(default=1_000_000, ge=9600, le=12_000_000)
    debounce_us: int = Field(default=5000, ge=0, le=1_000_000)


ALL_INPUTS = 0xFF
HEARTBEAT_MS = 500
EDGES_HEARTBEAT_MS = 20  # of a board that never streams: nothing else has its time
TEMPERATURE_MS = 2000
MAX_LATCHES = 16
# The clock is tied by the quickest of some answers; then its smallest delay is measured
# again and again, often as long as the rate is not known.
QUICK_ANSWER_NS = 500_000
FRAME_BYTES = 60  # of a latch; what a board that is never asked takes at least
TIES, TIE_NS = 8, 200_000_000
TIE_AGAIN_NS, MEASURE_DELAY_NS = 100_000_000, 1_000_000_000
ROUND_TRIPS = 3  # of which the middle one counts
# The board sends an edge again after 50 ms. So it is acknowledged a little later, not
# while its point is on its way, and several are at once.
AGAIN_NS = 70_000_000
ACKNOWLEDGED_NS = 20_000_000
IDLE_NS = 100_000_000  # of a board that sends nothing


class LatchBoardDriver(Driver):
    """A board that latches all encoders of an arm at one instant."""

    options: LatchBoardOptions
    options_class = LatchBoardOptions

    def _prepare(self) -> None:
        self._path = self.options.port
        self._latches: deque[int] = deque()
        self._latch_token = 0
        self._edges = EdgeSequencer()
        # The thread's own.
        self._port: SerialPort | None = None
        self._line: LatchBoardLine | None = None
        self._boot_id: int | None = None
        self._clock_before: DeviceClock | None = None  # of the last connection
        self._session: LatchBoardSession | None = None  # until the board is known
        self._clock_reporter = ClockReporter(self.device, self._delivery_queue.put)
        self._can_latch = self._answers_stop = False
        self._round_trips_ns: deque[int] = deque(maxlen=ROUND_TRIPS)
        self._round_trips_after = 0  # steps of the clock
        self._exchanged_ns = self._acknowledged_ns = 0
        self._taken_ns = 0  # until when received messages have been processed
        self._frames_before = 0

    def request_latch(self) -> int:
        if len(self._latches) >= MAX_LATCHES:
            raise DeviceError(
                f"{MAX_LATCHES} latch requests wait for {self.device}",
                "request latches less often",
            )
        self._latch_token += 1
        self._latches.append(self._latch_token)
        self._wake()
        return self._latch_token

    def acknowledge(self, token: int) -> None:
        """Have edges up to ``token`` acknowledged to the board soon."""
        self._edges.acknowledge(token)

    # -- in the reader thread -------------------------------------------------

    def _put(self, delivery: CountSamples | LatchedCounts) -> bool:
        """Hand over; a release, of which no point is made, wakes nobody by itself."""
        is_release = isinstance(delivery, LatchedCounts) and not delivery.active
        return self._delivery_queue.put(delivery, wakes=not is_release)

    def _connect(self) -> None:
        self._port = SerialPort(self._path, self.options.baud_rate, self._wake_read)
        line = self._line = LatchBoardLine(
            self._port, self._now_ns, self._dispatch, lambda: self._stopping
        )
        line.port.write(b"\0")  # ends whatever the line carried before
        first = self._boot_id is None
        if first:  # HELLO has the board forget edges: they are counted before
            until_ns = self._now_ns() + AGAIN_NS
            while (left_ns := until_ns - self._now_ns()) > 0 and not self._stopping:
                if line.port.wait(left_ns * 1e-9):
                    line.read()
        flags = wire.FORGET_EDGES if first else 0
        hello = line.ask("HELLO", lambda number: wire.hello_request(number, flags))
        if not isinstance(hello, wire.Hello):
            raise DeviceError(f"HELLO was answered by {hello}", "update the firmware")
        check_identification(hello, self._path)
        self._latches.clear()  # their requesters have timed out
        heartbeat_ms = HEARTBEAT_MS if hello.channels else EDGES_HEARTBEAT_MS
        line.ask(
            "CONFIGURE",
            lambda number: wire.configure_request(
                number,
                ALL_INPUTS,
                heartbeat_ms,
                TEMPERATURE_MS,
                self.options.debounce_us,
            ),
        )
        self._clock_reporter.forget()
        clock = self._learned_clock(line, hello)
        restarted = not first and (
            hello.boot_id != self._boot_id or self._counts_anew(clock)
        )
        self._deliver_state(DeviceUp(self.device, board_identity(hello), restarted))
        # Not earlier: if CONFIGURE fails, the next try has to report the restart.
        if restarted:
            self._edges = EdgeSequencer(0)
        self._boot_id = hello.boot_id
        self._session = LatchBoardSession(  # from now on edges are taken
            self.device,
            self._path,
            self._edges,
            clock=clock,
            n_channels=len(hello.channels),
            debounce_ns=self.options.debounce_us * 1000,
            put=self._put,
            fault=self._fault,
            counters=self._counters,
        )
        self._streams_begun = 0  # the requested stream is to be requested again

    def _learned_clock(self, line: LatchBoardLine, hello: wire.Hello) -> DeviceClock:
        latency_ns = line.port.latency_ns + FRAME_BYTES * line.port.byte_ns
        clock = DeviceClock(hello.tick_rate_hz, latency_ns=latency_ns)
        until_ns = self._now_ns() + TIE_NS
        self._can_latch = bool(hello.channels)
        self._answers_stop = not hello.channels
        self._port_latency_ns = latency_ns
        if self._answers_stop:
            self._measure_round_trip(line, clock)
        for _ in range(TIES if self._can_latch else 0):
            taken_ns = self._exchange_times(line, clock)
            if taken_ns < QUICK_ANSWER_NS or self._now_ns() >= until_ns:
                break
        return clock

    def _counts_anew(self, clock: DeviceClock) -> bool:
        """Whether a board has lost power by its counter, not by its boot_id.

        Firmware without a source of chance may have the same one each time.
        """
        before, last = self._clock_before, clock.last
        if before is None or last is None:
            return False
        return not before.is_continued_by(*last)

    def _exchange_times(self, line: LatchBoardLine, clock: DeviceClock) -> int:
        """Measure the board's clock by a request and its answer; how long it took."""
        self._exchanged_ns = sent_ns = self._now_ns()
        answer = self._request_or_fault(line, "LATCH", wire.latch_request)
        if not isinstance(answer, wire.Latched):
            self._can_latch = False
            return 0
        received_ns = line.last_message_ns
        clock.update(clock.unwrap_one(answer.ticks), received_ns, sent_ns)
        return received_ns - sent_ns

    def _measure_round_trip(self, line: LatchBoardLine, clock: DeviceClock) -> None:
        """Bound the smallest delay of a board without joints, which cannot latch.

        Its messages take no longer than a request and its answer. Of the latest three
        the middle one counts: a busy host makes single ones longer, and before a line
        became slower they were shorter.
        """
        self._exchanged_ns = sent_ns = self._now_ns()
        if self._request_or_fault(line, "STOP", wire.stop_request) is None:
            self._answers_stop = False
            return
        if clock.steps != self._round_trips_after:
            self._round_trips_after = clock.steps
            self._round_trips_ns.clear()
        self._round_trips_ns.append(line.last_message_ns - sent_ns)
        clock.state_latency(
            max(self._port_latency_ns, median_high(self._round_trips_ns))
        )

    def _measure_clock(self, line: LatchBoardLine, session: LatchBoardSession) -> None:
        """Measure the board's clock if a reading makes it doubtful, or periodically.

        Late readings wait for the answer: it shows whether the host was busy or the
        board's counter stood still.
        """
        clock, now_ns = session.clock, self._now_ns()
        if self._can_latch:
            pause_ns = MEASURE_DELAY_NS if clock.is_well_known else TIE_AGAIN_NS
            if session.holds or now_ns - self._exchanged_ns > pause_ns:
                self._exchange_times(line, clock)
        elif self._answers_stop and (
            clock.steps != self._round_trips_after
            or now_ns - self._exchanged_ns > MEASURE_DELAY_NS
        ):
            self._measure_round_trip(line, clock)
        session.release()
        self._clock_reporter.report(clock, now_ns)

    def _serve(self) -> None:
        line, session, broken = self._line, self._session, 0
        while line is not None and session is not None and not self._stopping:
            self._carry_out_requests(line, session)
            due_ns = self._acknowledge_if_due()
            wait_ns = IDLE_NS if due_ns is None else due_ns - self._now_ns()
            is_readable = line.port.wait(max(0, wait_ns) * 1e-9)
            with self._delivery_queue.together():
                if is_readable:
                    self._read(line)
                line.check_alive()
                self._measure_clock(line, session)
                if newly_broken := line.decoder.faults.total() - broken:
                    broken += newly_broken
                    self._fault(
                        "frames_rejected",
                        f"{newly_broken} broken frames on {self._path}",
                        "check cable, shielding and baud rate",
                        newly_broken,
                    )
                self._counters["frames_received"] = (
                    self._frames_before + line.decoder.accepted
                )
                self._report_counters()

    def _read(self, line: LatchBoardLine) -> None:
        """Read and process arrived bytes.

        A block of one costs as much to decode as a block of many. Bytes are read on
        arrival, so that none wait in the port.
        """
        window_ns = self._delivery_queue.batch_window_ns
        until_ns = max(self._taken_ns + window_ns, self._now_ns())
        line.read(until_ns, self._acknowledge_if_due)
        self._taken_ns = min(until_ns, self._now_ns())

    def _disconnect(self) -> None:
        if self._session is not None:
            self._clock_before, self._session = self._session.clock, None
        if self._line is not None:
            self._counters["requests_repeated"] += self._line.repeated
            self._frames_before += self._line.decoder.accepted
            self._line = None
        if self._port is not None:
            self._port.close()
            self._port = None

    def _carry_out_requests(
        self, line: LatchBoardLine, session: LatchBoardSession
    ) -> None:
        while self._latches:
            # Its answer is taken here and not when it is dispatched, so that a late
            # answer to an earlier try is not a second latch.
            self._exchanged_ns = sent_ns = self._now_ns()
            answer = self._request_or_fault(line, "LATCH", wire.latch_request)
            token = self._latches.popleft()
            if isinstance(answer, wire.Latched):
                session.take_latch(answer, token, sent_ns, line.last_message_ns)
        if self._streams_begun != (n_requested := self._streams_requested):
            self._streams_begun = n_requested
            rate = round(self._rate_hz * 1000)
            session.begin_stream(0, 0)  # what still arrives is of the old one
            if rate:
                self._request_or_fault(
                    line, "START", lambda number: wire.start_request(number, rate)
                )
            else:
                self._request_or_fault(line, "STOP", wire.stop_request)

    def _acknowledge_if_due(self) -> int | None:
        """Acknowledge processed edges to the board; have waiting ones processed.

        Returns:
            When that is due again [ns]; None if the board waits for nothing.
        """
        if not self._edges.needs_acknowledgement or self._port is None:
            return None
        now_ns = self._now_ns()
        if now_ns - self._acknowledged_ns >= ACKNOWLEDGED_NS:
            self._acknowledged_ns = now_ns
            self._delivery_queue.wake()
            if (done := self._edges.take_acknowledgement()) is not None:
                self._port.write(wire.edge_ack(done))
        return self._acknowledged_ns + ACKNOWLEDGED_NS

    def _request_or_fault(
        self, line: LatchBoardLine, name: str, frame: Callable[[int], bytes]
    ) -> Response | None:
        """Return the answer; None where the board refused and keeps refusing."""
        try:
            return line.ask(name, frame)
        except DeviceRefusedError as error:
            self._fault("request_refused", str(error), error.remedy)
            return None

    def _dispatch(
        self, message: wire.Message, received_ns: int, earlier: PartialReads
    ) -> None:
        session = self._session  # until HELLO it may be of another board
        match message:
            case wire.Reply(request_type=wire.START, result=0) if session is not None:
                # Its samples may be in the same read: be ready for them now.
                self._start_stream(message.value / 1000)
                session.begin_stream(self._stream, message.request)
            case wire.Temperatures():
                self._delivery_queue.put(
                    DeviceTemperatures(
                        self.device, message.values_c, TEMPERATURE_MS * 1_000_000
                    )
                )
            case wire.Alarm():
                self._delivery_queue.put(device_alarm(self.device, message))
            case _ if session is not None:
                session.take(message, received_ns, earlier)
            case wire.SampleBlock():
                self._counters["samples_of_old_stream"] += len(message.seq)
            case wire.Edge():
                self._edges.note_missed(message.seq)
            case _:
                pass  # heartbeats are repeated after HELLO
