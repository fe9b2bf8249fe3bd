"""Driver of a MicroScribe arm (Immersion HCI 2 and 3) on a serial line.

Without a maker's document: the timer is taken for one of 1 kHz (`timer_rate_hz`), and
not used if a check of it fails; more in `traverse.protocol.microscribe.packets` and
`traverse.protocol.microscribe.session`.

The encoders are incremental: an arm that lost power counts from its home position
again, so it must be there when switched on.
"""

import contextlib
from typing import Literal

from pydantic import Field

from traverse.drivers.base.driver import Driver, DriverOptions
from traverse.drivers.base.pending_edges import PendingEdges
from traverse.drivers.base.values import DeviceError, DeviceUp
from traverse.drivers.io.serial_port import SerialPort
from traverse.drivers.microscribe.line import MicroscribeLine, TimedPacket
from traverse.drivers.microscribe.session import (
    MicroscribeIdentification,
    MicroscribeSession,
    MotionReport,
    connect,
)
from traverse.drivers.polling.alarms import ReadErrorLog
from traverse.drivers.polling.channel import IMPLAUSIBLE
from traverse.drivers.polling.pedals import PedalDebouncer
from traverse.drivers.polling.sampling import SampleBlockBuilder, SampleSchedule
from traverse.plurals import counted
from traverse.protocol.microscribe.packets import N_BUTTONS

BaudRate = Literal[9600, 14400, 19200, 28800, 38400, 57600, 115200]


class MicroscribeOptions(DriverOptions):
    """Options of a MicroScribe.

    Packets are sent on "request", or by the arm's own "motion"; 0 as timer rate leaves
    its timer unused.
    """

    port: str = Field(min_length=1)
    baud_rate: BaudRate = 115200
    report: Literal["request", "motion"] = "request"
    timer_rate_hz: float = Field(default=1000.0, ge=0.0, le=100_000.0)
    debounce_ms: int = Field(default=20, ge=0, le=1000)
    max_speed_rad_s: float = Field(default=20.0, gt=0.0, le=1000.0)


PEDAL_HZ = 100.0  # a press appears in two packets; least rate of requests
SILENCE_NS = 500_000_000
TELL_NS = 200_000_000


class MicroscribeDriver(Driver):
    """A MicroScribe."""

    options: MicroscribeOptions
    options_class = MicroscribeOptions

    def _prepare(self) -> None:
        options = self.options
        self._path = options.port
        self._by_motion = options.report == "motion"
        # The thread's own.
        self._arm: MicroscribeIdentification | None = None
        self._port: SerialPort | None = None
        self._session: MicroscribeSession | None = None
        self._pedals = PedalDebouncer(options.debounce_ms * 1_000_000, N_BUTTONS)
        put = self._delivery_queue.put
        self._edges = PendingEdges(self.device, put, self._fault, self._counters)
        self._read_errors = ReadErrorLog(self.device, put, self._counters)
        self._lost_samples = self._rejected = 0  # not yet reported; of this line
        self._block = SampleBlockBuilder(self.device, put)
        self._last_counts: tuple[int, ...] = ()
        self._next_seq = self._told_ns = self._answered_ns = self._old_before = 0

    # -- in the reader thread -------------------------------------------------

    def _connect(self) -> None:
        before, options = self._arm, self.options
        line, arm, resumed = connect(self._open_line, options.baud_rate, before)
        self._port = line.port
        self._session = session = MicroscribeSession(
            line, arm, options.timer_rate_hz, options.max_speed_rad_s, self._now_ns
        )
        if options.timer_rate_hz and not session.timer_used:
            self._fault(
                "timer_unused",
                f"the timer of {arm.name} does not run at "
                f"{options.timer_rate_hz:g} Hz; times are those of the exchanges",
                "set timer_rate_hz, or 0 not to use it",
            )
        restarted = before is not None and not resumed
        self._deliver_state(DeviceUp(self.device, session.identity, restarted))
        # Not earlier: if that fails, the next try has to report the restart.
        self._arm = arm
        self._pedals.begin(session.first)
        self._rejected = 0
        self._streams_begun = 0  # the requested stream is to be started again
        self._answered_ns = self._now_ns()
        self._old_before = session.line.old

    def _open_line(self, baud_rate: int) -> MicroscribeLine:
        port = SerialPort(self._path, baud_rate, self._wake_read)
        return MicroscribeLine(port, baud_rate, self._now_ns, lambda: self._stopping)

    def _serve(self) -> None:
        session = self._session
        while session is not None and not self._stopping:
            self._streams_begun = self._streams_requested
            rate_hz = self._begin_stream(session, self._rate_hz)
            if self._by_motion:
                self._listen(session, rate_hz)
            else:
                self._poll(session, rate_hz)
            self._block.finish(self._stream)

    def _disconnect(self) -> None:
        if self._session is not None and self._stopping:
            with contextlib.suppress(DeviceError):
                self._session.line.end()
        self._session = None
        self._block.finish(self._stream)
        if self._port is not None:
            self._port.close()
            self._port = None

    def _begin_stream(self, session: MicroscribeSession, rate_hz: float) -> float:
        """Report the stream that begins; return its rate, 0 for none."""
        if not rate_hz:
            return 0.0
        self._next_seq = 0
        rate_hz = self._start_stream(
            rate_hz,
            session.reached_hz,
            "lower the rate, raise the baud rate, or set the adapter's latency timer "
            "to 1 ms",
        )
        self._block.begin(rate_hz, is_checked=False)
        return rate_hz

    def _goes_on(self, session: MicroscribeSession) -> bool:
        """Send pending reports; return whether the same stream is still requested."""
        self._edges.hand_over()
        now_ns = self._now_ns()
        if self._block.is_due(now_ns):
            self._block.deliver(self._stream)
        ends = self._stopping or self._streams_begun != self._streams_requested
        if ends:
            self._report_losses(session)  # there may be no later report
        elif now_ns - self._told_ns >= TELL_NS:
            self._told_ns = now_ns
            self._report_losses(session)
            self._read_errors.raise_if_all_missing(session.channels)
            self._read_errors.report(session.channels, now_ns)
        self._report_counters()
        if now_ns - self._answered_ns > SILENCE_NS:
            if session.line.old > self._old_before:
                raise DeviceError(
                    f"{session.arm.name} on {self._path} answers, but by its timer "
                    "too late for the requests",
                    "set the adapter's latency timer to 1 ms, or timer_rate_hz = 0 "
                    "not to use the arm's timer",
                )
            raise DeviceError(
                f"{session.arm.name} on {self._path} does not answer",
                "check its cable; if it was off, put it into its home position "
                "while it is switched on",
            )
        return not ends

    def _report_losses(self, session: MicroscribeSession) -> None:
        line, faults = session.line, session.decoder.faults
        self._counters["bytes_stray"] = line.unrequested_bytes + faults["stray"]
        self._counters["packets_old"] = line.old
        self._counters["clock_steps"] = session.clock.steps
        self._counters["timer_hz"] = round(session.clock.rate_hz)
        if rejected := faults["broken"] + faults["foreign"] - self._rejected:
            self._rejected += rejected
            self._fault(
                "frames_rejected",
                f"{rejected} broken packets on {self._path}",
                "check cable, shielding and baud rate",
                rejected,
            )
        if lost := self._lost_samples:
            self._lost_samples = 0
            self._fault(
                "samples_lost",
                f"{counted(lost, 'sample')} lost between {session.arm.name} and host",
                "lower the rate, or check cable and adapter",
                lost,
            )

    def _poll(self, session: MicroscribeSession, rate_hz: float) -> None:
        """Request packets, of which each n-th is a sample of the stream."""
        often_hz = min(PEDAL_HZ, session.reached_hz)
        every = max(1, int(often_hz / rate_hz)) if rate_hz else 0
        schedule = SampleSchedule(rate_hz * every or often_hz, self._now_ns())
        while self._goes_on(session):
            left_ns = schedule.next_ns - self._now_ns()
            if left_ns > 0:
                if session.line.port.wait(left_ns * 1e-9):
                    session.line.drop_stray()
                continue
            number, _, _ = schedule.take(self._now_ns())
            if (packet := session.ask()) is not None:
                streamed = every and number % every == 0
                self._take(session, packet, number // every if streamed else None)

    def _listen(self, session: MicroscribeSession, rate_hz: float) -> None:
        """Receive the packets sent on motion; each is a sample of the stream."""
        delay_ms = max(1, round(1000.0 / (rate_hz or PEDAL_HZ)))
        report = MotionReport(session, delay_ms, self._now_ns)
        report.begin()
        broken = session.decoder.faults["broken"]
        while self._goes_on(session):
            packets = report.read(0.02)
            answer = None
            if report.is_quiet(unsettled=self._pedals.unsettled):
                report.end()
                if (answer := session.ask()) is not None:
                    packets.append(answer)
                report.begin()
            for packet in packets:  # a broken packet would have had a number too
                seq = self._next_seq + session.decoder.faults["broken"] - broken
                broken = session.decoder.faults["broken"]
                self._take(
                    session,
                    packet,
                    seq if rate_hz else None,
                    reported=packet is not answer,
                )
        report.end()

    def _take(
        self,
        session: MicroscribeSession,
        packet: TimedPacket,
        seq: int | None,
        *,
        reported: bool = False,
    ) -> None:
        """Take a packet.

        ``seq`` is given if it belongs to the stream, ``reported`` if a change caused
        it.
        """
        self._answered_ns = packet.received_ns
        self._old_before = session.line.old
        self._counters["packets_received"] += 1
        sample, implausible = session.sample_of(packet)
        for number in implausible:
            self._read_errors.add(number, session.channels[number], IMPLAUSIBLE)
        if sample.complete:
            certain = reported and sample.counts == self._last_counts
            self._last_counts = sample.counts
            for edge in self._pedals.detect_edges(sample, certain=certain):
                self._edges.add(edge.number, edge.down, edge.first)
        if seq is not None:
            self._lost_samples += max(0, seq - self._next_seq)
            self._next_seq = seq + 1
            self._counters["samples_received"] += 1
            self._block.add(seq, sample, session.doubts(packet.received_ns))
