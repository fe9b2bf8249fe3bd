"""Driver of boards that print lines of text, one for each reading of all joints.

The board prints at a rate of its own, which is learned while connecting. A line is read
whole or not at all (`line`), and must be within reach of the joints. Without a time in
the line a sample has the time of its arrival, which is uncertain where lines have
waited. A board whose time or counts jump has lost power.
"""

from dataclasses import dataclass

import numpy as np

from traverse.drivers.base.driver import Driver
from traverse.drivers.base.pending_edges import PendingEdges
from traverse.drivers.base.values import (
    STATUS_MISSING,
    STATUS_TIME_UNCERTAIN,
    CountSamples,
    DeviceError,
    DeviceUp,
    Identity,
    PolledSample,
)
from traverse.drivers.io.serial_port import SerialPort
from traverse.drivers.polling.channel import IMPLAUSIBLE, EncoderReading, PolledChannel
from traverse.drivers.polling.pedals import PedalDebouncer
from traverse.drivers.polling.repeats import RepeatDetector
from traverse.drivers.polling.sampling import SampleBlockBuilder
from traverse.drivers.text_line.board_time import (
    WRAP_SLACK_S,
    check_advance,
    wrap_of,
)
from traverse.drivers.text_line.line import Line, LineSplitter, OddLine
from traverse.drivers.text_line.line_rate import (
    LEAST_LINES,
    LineRateMonitor,
    first_period_ns,
)
from traverse.drivers.text_line.options import TextLineOptions
from traverse.drivers.timing.clock_report import ClockReporter
from traverse.drivers.timing.device_clock import DeviceClock
from traverse.plurals import counted

FIRST_LINES = 10  # to learn the rate
FIRST_SPAN_NS = 600_000_000  # lines may arrive in bunches; the clock takes as long
FIRST_S = 8.0  # a board that is reset by opening its port needs two
START_AGAIN_NS = 1_000_000_000
TELL_NS = 200_000_000
LOST_ABOVE = 1.75  # periods between two lines
# Between the times of board and host: it was reset. A busy host is late by less.
JUMP_NS = 3_000_000_000
JUMPS = 2  # in a row: one may be a broken digit
# Lines that are late wait so long for one that is not: then the host was busy, else
# the board's clock stood still.
HOLD_NS, HOLD_PERIODS, MAX_HELD = 100_000_000, 2.5, 1000
# Where lines have no time: if a read has more or fewer than the time since the last one
# explains, some have waited, or were lost; those of a bunch are read within so long.
MOST_UNEXPLAINED, BUNCH_NS = 2.0, 500_000_000


@dataclass(frozen=True, slots=True)
class _Arrived:
    """A line that has arrived.

    Attributes:
        ticks: the board's time, unwrapped; None if the line has none.
        arrived_ns: of the line, by those that were read with it.
        step: lines since the last one.
    """

    line: Line
    ticks: int | None
    arrived_ns: int
    received_ns: int
    step: int
    bad: int


class TextLineDriver(Driver):
    """A board that prints lines."""

    options: TextLineOptions
    options_class = TextLineOptions

    def _prepare(self) -> None:
        options = self.options
        self._pattern = options.line_pattern
        # The thread's own.
        self._port: SerialPort | None = None
        put = self._delivery_queue.put
        self._edges = PendingEdges(self.device, put, self._fault, self._counters)
        self._buttons = PedalDebouncer(
            options.debounce_ms * 1_000_000, self._pattern.n_inputs
        )
        self._block = SampleBlockBuilder(self.device, put)
        # All lines, where only some of them are samples.
        self._lines = SampleBlockBuilder(self.device, self._look_for_repeats)
        self._clock_reporter = ClockReporter(self.device, put)
        self._held: list[_Arrived] = []
        self._line_bytes = 0
        self._next_seq = self._every = self._rejected = self._lost = 0
        self._reason = ""
        self._told_ns = 0
        self._up_before = self._reset = False
        self._last: tuple[Line, int] | None = None  # with the time of its arrival
        self._period_ns = 0.0
        self._bunch_until_ns = 0  # lines may have waited

    # -- in the reader thread -------------------------------------------------

    def _connect(self) -> None:
        options = self.options
        self._port = SerialPort(options.port, options.baud_rate, self._wake_read)
        self._splitter = LineSplitter()
        self._clock = DeviceClock(options.tick_rate_hz, options.wrap_ticks)
        self._clock_reporter.forget()
        self._held.clear()
        self._ticks: int | None = None  # of the last line, unwrapped
        self._time_ns = 0
        self._channels = [
            PolledChannel(
                *(f"joint {k}", counts, counts, options.max_speed_rad_s),
                is_checked=options.checksum != "none",
            )
            for k, counts in enumerate(options.counts_per_turn, start=1)
        ]
        turns = np.array(options.counts_per_turn, np.int64)
        places, count_rad = np.arange(len(turns)), 2.0 * np.pi / turns
        self._detector = RepeatDetector(self.device, places, turns, count_rad)
        self._overlong = self._bad = self._jumps = 0
        before, period_ns = self._last, self._period_ns
        first = self._first_lines(self._port)
        lines = [line for line, _ in first]
        times = [(line.ticks, at_ns) for line, at_ns in first if line.ticks is not None]
        check_advance(
            times, options.port, options.time_unit, 1e9 / options.tick_rate_hz
        )
        self._period_ns = first_period_ns(first, 1e9 / options.tick_rate_hz)
        restarted = self._up_before and (
            self._reset or not self._continues(before, first[-1], period_ns)
        )
        self._last = first[-1]
        port = self._port
        # The time in a line is taken before it is sent: no line is earlier than that.
        latency_ns = port.latency_ns + self._line_bytes * port.byte_ns
        self._clock.state_latency(latency_ns)
        for line, received_ns in first:
            ticks = self._learn(line, received_ns)
            arrived = _Arrived(line, ticks, received_ns, received_ns, 1, 0)
            sample = self._sample(arrived)
        self._bunch_until_ns = first[-1][1] + BUNCH_NS
        self._line_rate = LineRateMonitor(self._period_ns, first[-1][1])
        self._buttons.begin(sample)
        resolution_ns = 1e9 / options.tick_rate_hz
        has_time = lines[0].ticks is not None
        self._deliver_state(
            DeviceUp(
                self.device,
                Identity(
                    f"board on {options.port}",
                    "",
                    options.counts_per_turn,
                    self._pattern.n_inputs,
                    1e9 / self._period_ns,
                    latches=False,
                    counts_per_turn=options.counts_per_turn,
                    jitter_ns=round(
                        latency_ns
                        + (max(resolution_ns, 1e6) if has_time else self._period_ns / 2)
                    ),
                    steps_counts=self._pattern.steps_counts,
                ),
                restarted,
            )
        )
        # Not earlier: if that fails, the next try has to report the restart.
        self._up_before, self._reset = True, False
        self._streams_begun = 0

    def _serve(self) -> None:
        while self._port is not None and not self._stopping:
            if self._streams_begun != self._streams_requested:
                self._streams_begun = self._streams_requested
                self._begin_stream(self._rate_hz)
            if self._port.wait(0.02):
                self._take(self._read(self._port))
            now_ns = self._now_ns()
            self._release(now_ns)
            if self._last is not None and self._last[0].ticks is not None:
                self._clock_reporter.report(self._clock, now_ns)
            self._edges.hand_over()
            for block in (self._block, self._lines):
                if block.is_due(now_ns):
                    block.deliver(self._stream)
            if now_ns - self._told_ns >= TELL_NS:
                self._told_ns = now_ns
                self._report_losses()
            self._report_counters()
            if self._last and now_ns - self._last[1] > self.options.silence_s * 1e9:
                raise self._silence()

    def _disconnect(self) -> None:
        self._held.clear()
        self._report_losses()
        self._block.finish(self._stream)
        if self._port is not None:
            self._port.close()
            self._port = None

    def _read(self, port: SerialPort) -> tuple[list[tuple[Line, int]], int]:
        """Return valid lines with the number of odd ones before, and the time [ns]."""
        lines = []
        splitter = self._splitter
        raws = splitter.feed(port.read())
        received_ns = self._now_ns()
        for _ in range(splitter.overlong - self._overlong):
            self._reject(b"", "has no end")
        self._overlong = splitter.overlong
        for raw in raws:
            if raw.startswith(tuple(text.encode() for text in self.options.ignore)):
                self._counters["lines_ignored"] += 1
                continue
            self._line_bytes = max(self._line_bytes, len(raw) + 2)
            line = self._pattern.read(raw)
            if isinstance(line, OddLine):
                self._reject(raw, line.reason)
            else:
                lines.append((line, self._bad))
                self._bad = 0
        return lines, received_ns

    def _reject(self, raw: bytes, reason: str) -> None:
        self._rejected += 1
        self._bad += 1
        shown = f" {raw[:60].decode('ascii', 'replace')!r}" if raw else ""
        self._reason = f"a line{shown} {reason}"

    def _first_lines(self, port: SerialPort) -> list[tuple[Line, int]]:
        """Return successive valid lines, to learn from, with their times.

        Raises:
            DeviceError: no such lines.
        """
        begun_ns = self._now_ns()
        asked_ns = begun_ns - START_AGAIN_NS
        first: list[tuple[Line, int]] = []
        while not self._stopping and (
            len(first) < FIRST_LINES or first[-1][1] - first[0][1] < FIRST_SPAN_NS
        ):
            now_ns = self._now_ns()
            self.heartbeat.beat()
            if now_ns - begun_ns > FIRST_S * 1e9:
                if len(first) > LEAST_LINES:
                    break  # it is slow
                raise self._silence()
            command = self.options.start_command
            if command and not first and now_ns - asked_ns >= START_AGAIN_NS:
                asked_ns = now_ns
                port.write(command.encode() + b"\n")
            if port.wait(0.05):
                lines, received_ns = self._read(port)
                first += [(line, received_ns) for line, _ in lines]
        if not first:
            raise DeviceError("the driver is closed", "")
        # What a board prints at its start, and half a first line, is no fault.
        self._counters["lines_before_first"] += self._rejected
        self._rejected = self._bad = 0
        return first

    def _continues(
        self, before: tuple[Line, int] | None, now: tuple[Line, int], period_ns: float
    ) -> bool:
        """Return whether the board ran since its last line, by time or number."""
        if before is None:
            return False
        elapsed_ns = now[1] - before[1]
        if now[0].ticks is not None and before[0].ticks is not None:
            step = (now[0].ticks - before[0].ticks) % self.options.wrap_ticks
            step_ns = step * 1e9 / self.options.tick_rate_hz
        elif now[0].seq is not None and before[0].seq is not None:
            step_ns = (
                (now[0].seq - before[0].seq) % (1 << self.options.seq_bits) * period_ns
            )
        else:
            return False
        return abs(step_ns - elapsed_ns) < JUMP_NS + 0.02 * elapsed_ns

    def _begin_stream(self, rate_hz: float) -> None:
        self._block.finish(self._stream)
        self._lines.finish(self._stream)
        self._every = 0
        if not rate_hz:
            return
        # The board prints when it likes: every line or one in some is a sample.
        reached_hz = 1e9 / self._period_ns
        self._every = max(1, round(reached_hz / rate_hz))
        self._next_seq = 0
        rate_hz = self._start_stream(
            rate_hz,
            reached_hz,
            "lower the rate, or have the board print more often",
            possible_hz=reached_hz / self._every,
        )
        self._block.begin(rate_hz, is_checked=self.options.checksum != "none")

    def _take(self, read: tuple[list[tuple[Line, int]], int]) -> None:
        """Take lines that arrived together.

        Raises:
            DeviceError: the board has been reset.
        """
        lines, received_ns = read
        if lines and self._last:
            expected = (received_ns - self._last[1]) / self._period_ns
            n_lines = len(lines) + sum(bad for _, bad in lines)
            if abs(n_lines - expected) > MOST_UNEXPLAINED:
                self._bunch_until_ns = received_ns + BUNCH_NS
        for number, (line, bad) in enumerate(lines):
            if bad:
                for channel in self._channels:
                    channel.doubt(received_ns)
            left = len(lines) - 1 - number
            arrived_ns = received_ns - round(left * self._period_ns)
            step = self._step(line, received_ns, bad)
            if step <= 0:
                continue
            before = self._ticks
            ticks = self._learn(line, received_ns)
            passed_ns = None
            if ticks is not None and before is not None:
                passed_ns = (ticks - before) * 1e9 / self.options.tick_rate_hz
            self._line_rate.add(1 + bad if line.seq is None else step, passed_ns)
            self._last = (line, received_ns)
            self._held.append(_Arrived(line, ticks, arrived_ns, received_ns, step, bad))
        self._release(received_ns)
        if self._line_rate.has_changed(received_ns):
            self._change_rate()

    def _change_rate(self) -> None:
        """Begin the stream anew at the rate that the board has now."""
        before_hz, self._period_ns = 1e9 / self._period_ns, self._line_rate.period_ns
        self._fault(
            "rate_changed",
            f"the board on {self.options.port} prints {1e9 / self._period_ns:.4g} "
            f"lines a second now; it was {before_hz:.4g}",
            "if it is not meant to, look at its program and at what else it sends",
        )
        if self._every:
            self._begin_stream(self._rate_hz)

    def _learn(self, line: Line, received_ns: int) -> int | None:
        """Return the unwrapped time of a line; the clock learns from it."""
        if line.ticks is None:
            return None
        self._ticks = ticks = self._clock.unwrap_one(line.ticks)
        self._clock.update(ticks, received_ns)
        self._counters["clock_steps"] = self._clock.steps
        return ticks

    def _release(self, now_ns: int) -> None:
        """Take lines, unless they wait for one that proves their times."""
        held = self._held
        if not held:
            return
        hold_ns = max(HOLD_NS, HOLD_PERIODS * self._period_ns)
        if (
            self._clock.is_late
            and len(held) < MAX_HELD
            and now_ns - held[0].received_ns < hold_ns
        ):
            return
        self._held = []
        for arrived in held:
            step = arrived.step
            sample = self._sample(arrived)
            self._counters["lines_received"] += 1
            self._lost += max(0, step - 1 - arrived.bad)
            self._next_seq += step
            if STATUS_MISSING not in sample.status:
                for edge in self._buttons.detect_edges(sample):
                    self._edges.add(edge.number, edge.down, edge.first)
            if self._every > 1:
                self._lines.add(self._next_seq - 1, sample)
            if self._every and (self._next_seq - 1) % self._every == 0:
                self._counters["samples_received"] += 1
                doubts = max(c.status(sample.time_ns) for c in self._channels)
                self._block.add((self._next_seq - 1) // self._every, sample, doubts)

    def _look_for_repeats(self, lines: CountSamples) -> bool:
        for repeat in self._detector.add(lines):
            self._delivery_queue.put(repeat)
        return True

    def _step(self, line: Line, received_ns: int, bad: int) -> int:
        """Return the step from the last line, 1 without a loss; 0: not to be taken.

        Raises:
            DeviceError: the board has been reset.
        """
        last = self._last[0] if self._last else line
        step = 1 + bad
        if line.seq is not None and last.seq is not None:
            limit = 1 << self.options.seq_bits
            step = (line.seq - last.seq + limit // 2) % limit - limit // 2
        if line.ticks is not None and last.ticks is not None:
            tick_ns = 1e9 / self.options.tick_rate_hz
            ticks = self._clock.unwrap_one(line.ticks)
            passed_ns = (ticks - self._clock.unwrap_one(last.ticks)) * tick_ns
            if passed_ns < 0 or self._clock.to_ns(ticks) - received_ns > JUMP_NS:
                step = -1
            elif line.seq is not None:
                pass
            elif passed_ns == 0 and self._period_ns > 2 * tick_ns:
                step = 0
            elif passed_ns > LOST_ABOVE * self._period_ns:
                step = round(passed_ns / self._period_ns)
        if step >= 0:
            self._jumps = 0
            self._counters["lines_repeated"] += step == 0
            return step
        self._jumps += 1
        self._reject(b"", "has a time or number that does not follow the last")
        if self._jumps >= JUMPS:
            raise self._has_begun_anew(line, received_ns)
        return 0

    def _has_begun_anew(self, line: Line, received_ns: int) -> DeviceError:
        """Say by how much the time of a line is not that after the last one."""
        last, last_ns = self._last or (line, received_ns)
        if line.ticks is None or last.ticks is None:
            return self._was_reset("its number has begun anew")
        passed_s = (line.ticks - last.ticks) / self.options.tick_rate_hz
        ahead_s = passed_s - (received_ns - last_ns) * 1e-9
        if abs(ahead_s) < WRAP_SLACK_S:
            return self._was_reset("its number has begun anew, and its time goes on")
        self._reset = True
        # They are no broken lines, of which cable or baud rate might be the cause.
        self._rejected = max(0, self._rejected - self._jumps)
        wrap = wrap_of(-ahead_s, self.options.time_unit)
        if wrap is not None:
            return DeviceError(f"the board on {self.options.port}: {wrap[0]}", wrap[1])
        way = "ahead" if ahead_s > 0.0 else "back"
        return self._was_reset(f"its time went {way} by {abs(ahead_s):.3f} s")

    def _sample(self, arrived: _Arrived) -> PolledSample:
        """Convert a line to a sample.

        Raises:
            DeviceError: counts have jumped and stay there.
        """
        line, clock, received_ns = arrived.line, self._clock, arrived.received_ns
        time_ns = ticks = arrived.arrived_ns
        bound_ns = 0
        is_uncertain = received_ns < self._bunch_until_ns
        if arrived.ticks is not None:
            ticks = arrived.ticks
            time_ns = min(clock.to_ns(ticks), received_ns)
            is_uncertain = clock.is_uncertain
            bound_ns = clock.error_bound_ns
        self._time_ns = time_ns = max(time_ns, self._time_ns)
        # Lines without a time of their own are as late as reading them was.
        about_ns = bound_ns or self._period_ns
        uncertain = STATUS_TIME_UNCERTAIN if is_uncertain else 0
        status = []
        for channel, count in zip(self._channels, line.counts, strict=True):
            reading = EncoderReading(count, time_ns, bound_ns=round(about_ns))
            miss = channel.accept(reading, time_ns)
            status.append(STATUS_MISSING if miss else uncertain)
            if miss is IMPLAUSIBLE:
                self._counters["implausible"] += 1
                self._rejected += 1
                self._reason = f"{channel.name} {miss.text}"
            if channel.missing:
                raise self._was_reset(f"{channel.name} has jumped")
        if doubts := max(c.status(time_ns) for c in self._channels):
            status = [bits | doubts for bits in status]  # one line has them all
        counts = tuple(channel.count for channel in self._channels)
        return PolledSample(
            *(time_ns, received_ns, ticks, line.buttons, counts, tuple(status)),
            time_bound_ns=bound_ns,
        )

    def _was_reset(self, why: str) -> DeviceError:
        self._reset = True
        return DeviceError(
            f"the board on {self.options.port} was probably reset: {why}",
            "check its supply and cable, and that no joint turns faster than "
            "max_speed_rad_s",
        )

    def _silence(self) -> DeviceError:
        if self._reason:
            return DeviceError(
                f"the board on {self.options.port} prints no line that fits: "
                f"{self._reason}",
                "correct pattern, unit, time_unit, baud_rate, or the encoder that is "
                "named",
            )
        return DeviceError(
            f"the board on {self.options.port} prints nothing",
            "check cable, baud_rate and start_command",
        )

    def _report_losses(self) -> None:
        if rejected := self._rejected:
            self._rejected = 0
            self._fault(
                "frames_rejected",
                f"{counted(rejected, 'line')} not read on {self.options.port}; "
                f"{self._reason}",
                "check cable and baud rate; beginnings of other lines belong in ignore",
                rejected,
            )
        if lost := self._lost:
            self._lost = 0
            self._fault(
                "samples_lost",
                f"{counted(lost, 'line')} lost between the board on "
                f"{self.options.port} and host",
                "raise the baud rate, or have the board print less often",
                lost,
            )
