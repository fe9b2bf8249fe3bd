"""Whether a board keeps to docs/serial-protocol.md: the page's sentences as checks.

Each check plays a part of the conversation as a host and raises `MismatchError` where
the board does something else. Numbers are written out as they stand on the page.
"""

import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

from traverse.drivers.io.serial_port import SerialPort
from traverse.drivers.latch_board.conformance_line import (
    ConformanceLine,
    MismatchError,
    ReceivedFrame,
    described,
    hexadecimal,
    is_answer,
)
from traverse.protocol.latch_board import messages as wire

SAMPLE, TEMPERATURES, HEARTBEAT = 0x83, 0x85, 0x87
QUIET_S = 0.3  # what should not come has come by then
ANSWER_NS = 100_000_000
TRIES = 5  # of an answer that is to be in time: this computer may be busy, too
HEARTBEAT_TRIES = 3  # of a second of heartbeats, likewise
FIRST_SAMPLE_S = 0.010
LEAST_AGAIN_MS, MOST_AGAIN_MS = 38.0, 72.0  # of an edge that is sent every 50 ms
STREAM_MILLIHZ, STREAM_SAMPLES = 123_457, 40
RATE_ERROR = 0.025  # of a board's quartz, at most


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of one check: `pass`, `fail` or `not tested`."""

    name: str
    section: int
    result: str
    expected: str = ""
    came: str = ""


class BoardTester:
    """A board that is tested.

    Args:
        port: open port of the board.
        press_s: how long an operator has for a press and for its release; None: edges
            are not tested.
        ask: prompts the operator.
    """

    def __init__(
        self, port: SerialPort, press_s: float | None, ask: Callable[[str], None]
    ) -> None:
        self._line = ConformanceLine(port)
        self._press_s, self._ask_operator = press_s, ask
        self._hello: wire.Hello | None = None

    def results(self) -> Iterator[CheckResult]:
        """Run the checks; without a right HELLO no others."""
        self._line.write(b"\0")  # ends whatever the line carried before
        checks: list[tuple[str, int, Callable[[], str | None]]] = [
            ("HELLO and the identity", 4, self._check_identity),
            ("answers within 100 ms", 2, self._check_times),
            ("another major version", 2, self._check_major),
            ("refusals", 4, self._check_refusals),
            ("garbage and resynchronisation", 1, self._check_garbage),
            ("CONFIGURE and heartbeats", 3, self._check_heartbeats),
            ("temperatures", 4, self._check_temperatures),
            ("LATCH", 4, self._check_latch),
            ("START, timed samples, STOP", 4, self._check_stream),
            ("edges", 4, self._check_edges),
            ("no broken frames", 1, self._check_broken),
        ]
        for name, section, check in checks:
            yield self._run(name, section, check)
            if self._hello is None:
                return

    def _run(
        self, name: str, section: int, check: Callable[[], str | None]
    ) -> CheckResult:
        try:
            reason = check()
        except MismatchError as error:
            return CheckResult(name, error.section, "fail", error.expected, error.came)
        if reason is not None:
            return CheckResult(name, section, "not tested", came=reason)
        return CheckResult(name, section, "pass")

    # -- parts of the conversation ---------------------------------------------

    def _ask(self, section: int, layout: str, kind: int, *fields: int) -> ReceivedFrame:
        """Send a request with the next number; return its one answer."""
        request, n_broken = self._line.request_number(), len(self._line.broken)
        body = struct.pack(f"<BB{layout}", kind, request, *fields)
        answers = self._line.ask(request, body)
        if answers:
            return answers[0]
        expected = f"an answer to {hexadecimal(body)} within 100 ms"
        broken = self._line.broken[n_broken:]
        if not broken:
            raise MismatchError(section, expected, "none")
        shown = hexadecimal(broken[-1])
        raise MismatchError(1, expected, f"a frame with broken COBS or CRC: {shown}")

    def _expect_reply(
        self, section: int, result: int, value: int, layout: str, *request: int
    ) -> None:
        answer = self._ask(section, layout, *request)
        expected = struct.pack("<BBBBI", 0x82, request[0], 0, result, value)
        shown = hexadecimal(expected[:2]) + " .. " + hexadecimal(expected[3:])
        if answer.body[:2] + answer.body[3:] != expected[:2] + expected[3:]:
            raise MismatchError(section, shown, hexadecimal(answer.body))

    def _expect_silence(self, section: int, body: bytes) -> None:
        self._line.send(body)
        answers = [f for f in self._line.gather(QUIET_S) if f.body[0] in (0x81, 0x82)]
        if answers:
            sent = hexadecimal(body)
            raise MismatchError(section, f"no answer to {sent}", described(answers))

    def _greet(self, flags: int = 0) -> wire.Hello:
        """Say HELLO, and take the identity.

        Raises:
            MismatchError: it is no HELLO, or of a wrong length.
        """
        answer = self._ask(2, "BB", 1, 1, flags)
        hello = wire.PARSERS[0x81](answer.body) if answer.body[0] == 0x81 else None
        if not isinstance(hello, wire.Hello):
            expected = "HELLO: 81 .. 01, 34 bytes, 5 more for each channel"
            raise MismatchError(4, expected, hexadecimal(answer.body))
        return hello

    def _known(self) -> wire.Hello:
        if self._hello is None:
            raise RuntimeError("the identity is checked first")
        return self._hello

    def _heartbeat(self) -> wire.Heartbeat:
        """The next heartbeat, of every 50 ms."""
        self._expect_reply(3, 0, 0, "BHHI", 2, 0xFF, 50, 0, 5000)
        frames = self._line.gather(1.0, lambda frame: frame.body[0] == HEARTBEAT)
        beat = wire.PARSERS[HEARTBEAT](frames[-1].body) if frames else None
        if not isinstance(beat, wire.Heartbeat):
            raise MismatchError(4, "HEARTBEAT of 24 bytes", described(frames[-1:]))
        return beat

    # -- checks ------------------------------------------------------------------

    def _check_identity(self) -> None:
        hello = self._greet()
        for requirement, holds, observed in (
            ("major 1", hello.version[0] == 1, hello.version[0]),
            ("at most 32 channels", len(hello.channels) <= 32, len(hello.channels)),
            ("at most 8 inputs", hello.n_inputs <= 8, hello.n_inputs),
            ("at most 16 sensors", hello.n_temperatures <= 16, hello.n_temperatures),
            (
                "ticks at 100 kHz to 100 MHz",
                100_000 <= hello.tick_rate_hz <= 100_000_000,
                hello.tick_rate_hz,
            ),
            (
                "a largest rate of up to 10 kHz, 0 only without channels",
                (hello.max_rate_hz > 0) == bool(hello.channels)
                and hello.max_rate_hz <= 10_000,
                hello.max_rate_hz,
            ),
            *(
                (
                    f"channel {n}: 1 to 32 bits, a modulus of at most 2^bits",
                    1 <= c.bits <= 32 and 1 < c.modulus <= 1 << c.bits,
                    f"{c.bits} bits, {c.modulus}",
                )
                for n, c in enumerate(hello.channels)
            ),
        ):
            if not holds:
                raise MismatchError(4, requirement, str(observed))
        second_hello = self._greet()
        if (second_hello.board_id, second_hello.boot_id) != (
            hello.board_id,
            hello.boot_id,
        ):
            expected = f"{hello.board_id.hex()} and boot_id {hello.boot_id:08X} again"
            observed = f"{second_hello.board_id.hex()} and {second_hello.boot_id:08X}"
            raise MismatchError(4, expected, observed)
        self._hello = hello

    def _check_times(self) -> None:
        taken_ns = []
        for _ in range(TRIES):
            sent_ns = time.monotonic_ns()
            taken_ns.append(self._ask(2, "", 4).received_ns - sent_ns)
        if min(taken_ns) > ANSWER_NS:
            observed = f"{min(taken_ns) / 1e6:.0f} ms at best"
            raise MismatchError(2, "REPLY to STOP within 100 ms", observed)

    def _check_major(self) -> None:
        try:
            self._expect_reply(2, 4, 1, "BB", 1, 2, 0)
            self._expect_silence(2, bytes((4, self._line.request_number())))
        finally:
            self._greet()

    def _check_refusals(self) -> None:
        most = round(self._known().max_rate_hz * 1000)
        self._expect_reply(4, 1, 0, "", 0x1F)
        self._expect_reply(4, 2, 0, "", 3)  # START without a rate
        self._expect_reply(4, 2, 0, "BBB", 1, 1, 0, 0)  # HELLO with a byte too many
        self._expect_reply(4, 5, 0, "BHHI", 2, 0xFF, 0, 0, 1_000_001)
        if self._known().channels:
            self._expect_reply(4, 3, most, "I", 3, 0)
            self._expect_reply(4, 3, most, "I", 3, most + 1)
        self._expect_silence(1, bytes((6, 0, 0)))  # EDGE_ACK of another length
        self._expect_silence(1, bytes((0x83, self._line.request_number())))

    def _check_garbage(self) -> None:
        before = self._heartbeat().rx_rejected
        stop = bytes((4, 0x77))
        spoilt = bytes.fromhex("05 04 77 01 02 00")  # STOP with a wrong CRC
        segments = (spoilt, b"\x55" * 600 + b"\0", b"\x09\x01\0", b"\x02\x01\0")
        for segment in segments:
            self._line.write(segment)
            self._line.write(b"\0\0")
            answers = self._line.ask(0x77, stop)
            if [a.body for a in answers] != [bytes.fromhex("82 04 77 00 00 00 00 00")]:
                expected = f"82 04 77 00 00 00 00 00 after {hexadecimal(segment[:9])}"
                raise MismatchError(1, expected, described(answers))
        rejected = (self._heartbeat().rx_rejected - before) % (1 << 32)
        if rejected != len(segments):
            expected = f"rx_rejected {len(segments)} more after as many broken frames"
            raise MismatchError(1, expected, f"{rejected} more")
        for byte in bytes.fromhex("05 04 04 4F 91 00"):  # section 6, byte by byte
            self._line.write(bytes((byte,)))
            time.sleep(0.002)
        frames = self._line.gather(0.5, lambda frame: is_answer(frame, 4))
        if not frames or not is_answer(frames[-1], 4):
            raise MismatchError(1, "STOP that comes byte by byte answered", "nothing")

    def _check_second_of_heartbeats(self) -> None:
        frames = [f for f in self._line.gather(1.05) if f.body[0] == HEARTBEAT]
        beats = [wire.PARSERS[HEARTBEAT](frame.body) for frame in frames]
        ticks = [b.ticks for b in beats if isinstance(b, wire.Heartbeat)]
        if len(ticks) < len(beats) or not 8 <= len(beats) <= 12:
            expected = "10 HEARTBEATs of 24 bytes in a second of 100 ms each"
            raise MismatchError(4, expected, described(frames))
        period_ticks = 0.1 * self._known().tick_rate_hz
        passed = (ticks[-1] - ticks[0]) % (1 << 32) / (len(ticks) - 1)
        if abs(passed / period_ticks - 1.0) > 0.1:
            expected = f"{period_ticks:.0f} ticks from heartbeat to heartbeat"
            raise MismatchError(3, expected, f"{passed:.0f}")

    def _check_heartbeats(self) -> None:
        """Require ten heartbeats a second, at their interval, and none when off.

        Strategy: a busy computer runs an emulated board late, now and then. A board is
        wrong whose heartbeats are wrong in each of several seconds.
        """
        self._expect_reply(3, 0, 0, "BHHI", 2, 0xFF, 100, 0, 5000)
        for n_left in reversed(range(HEARTBEAT_TRIES)):
            try:
                self._check_second_of_heartbeats()
                break
            except MismatchError:
                if not n_left:
                    raise
        self._expect_reply(3, 0, 0, "BHHI", 2, 0xFF, 0, 0, 5000)
        late = [f for f in self._line.gather(QUIET_S) if f.body[0] == HEARTBEAT]
        if late:
            expected = "no HEARTBEAT after CONFIGURE with heartbeat_ms 0"
            raise MismatchError(3, expected, described(late))

    def _check_temperatures(self) -> str | None:
        n_sensors = self._known().n_temperatures
        if not n_sensors:
            return "it has no sensors"
        self._expect_reply(3, 0, 0, "BHHI", 2, 0xFF, 0, 50, 5000)
        frames = self._line.gather(1.0, lambda frame: frame.body[0] == TEMPERATURES)
        if not frames or len(frames[-1].body) != 5 + 2 * n_sensors:
            expected = f"TEMPERATURES (85) of {5 + 2 * n_sensors} bytes"
            raise MismatchError(4, expected, described(frames[-1:]))
        self._expect_reply(3, 0, 0, "BHHI", 2, 0xFF, 0, 0, 5000)
        return None

    def _latch(self) -> tuple[wire.Latched, ReceivedFrame]:
        answer = self._ask(4, "", 5)
        length = 12 + 5 * len(self._known().channels)
        expected = f"{length} bytes: 83 01 {answer.body[2]:02X} .. 00 00 00 00 ..."
        latched = (
            wire.PARSERS[SAMPLE](answer.body) if answer.body[0] == SAMPLE else None
        )
        right = len(answer.body) == length and answer.body[4:8] == bytes(4)
        if not (isinstance(latched, wire.Latched) and right):
            raise MismatchError(4, expected, hexadecimal(answer.body))
        return latched, answer

    def _check_latch(self) -> str | None:
        if not self._known().channels:
            return "it has no channels"
        (first, at_first) = self._latch()
        extra = [f for f in self._line.gather(QUIET_S) if f.body[0] in (0x82, SAMPLE)]
        if extra:
            raise MismatchError(2, "one SAMPLE alone for a LATCH", described(extra))
        (second, at_second) = self._latch()
        for n, channel in enumerate(self._known().channels):
            if first.counts[n] >= channel.modulus:
                expected = f"a count of channel {n} below {channel.modulus}"
                raise MismatchError(4, expected, str(first.counts[n]))
        passed_s = (at_second.received_ns - at_first.received_ns) * 1e-9
        ticks = (second.ticks - first.ticks) % (1 << 32)
        off_s = abs(ticks / self._known().tick_rate_hz - passed_s)
        if off_s > RATE_ERROR * passed_s + 0.1:  # a latch waits on a busy computer
            expected = f"{passed_s * self._known().tick_rate_hz:.0f} ticks between them"
            raise MismatchError(4, expected, str(ticks))
        return None

    def _check_stream(self) -> str | None:
        hello = self._known()
        if not hello.channels:
            return "it has no channels"
        rate_millihz = min(STREAM_MILLIHZ, round(hello.max_rate_hz * 1000))
        latched, _ = self._latch()
        before_ns = time.monotonic_ns()
        reply = self._ask(4, "I", 3, rate_millihz)
        passed_s = (reply.received_ns - before_ns) * 1e-9
        if reply.body[:2] + reply.body[3:4] != b"\x82\x03\0" or len(reply.body) != 8:
            raise MismatchError(4, "82 03 .. 00 ....", hexadecimal(reply.body))
        request = reply.body[2]
        rate = int.from_bytes(reply.body[4:], "little")
        n_frames = 0

        def enough(frame: ReceivedFrame) -> bool:
            nonlocal n_frames
            n_frames += frame.body[0] == SAMPLE
            return n_frames >= STREAM_SAMPLES

        seconds = 2.0 + STREAM_SAMPLES * 1000.0 / rate
        frames = [f for f in self._line.gather(seconds, enough) if f.body[0] == SAMPLE]
        self._check_samples(frames, request, rate)
        first = int.from_bytes(frames[0].body[8:12], "little")
        after_s = (first - latched.ticks) % (1 << 32) / hello.tick_rate_hz
        if after_s > FIRST_SAMPLE_S + passed_s + 0.1:
            expected = "sample 0 within 10 ms of START"
            raise MismatchError(3, expected, f"{after_s:.3f} s after the LATCH before")
        self._check_end(lambda: self._expect_reply(4, 0, 0, "", 4), "STOP")
        self._ask(4, "I", 3, rate_millihz)
        self._check_end(self._greet, "HELLO")
        return None

    def _check_samples(
        self, frames: list[ReceivedFrame], request: int, rate_millihz: int
    ) -> None:
        """Check numbers, ticks and lengths of a stream from its beginning."""
        hello = self._known()
        length = 12 + 5 * len(hello.channels)
        if len(frames) < STREAM_SAMPLES:
            expected = f"{STREAM_SAMPLES} SAMPLEs at {rate_millihz / 1000:g} Hz"
            raise MismatchError(4, expected, described(frames))
        first = int.from_bytes(frames[0].body[8:12], "little")
        for seq, frame in enumerate(frames):
            span = hello.tick_rate_hz * 1000
            offset = (2 * seq * span + rate_millihz) // (2 * rate_millihz)
            ticks = (first + offset) % (1 << 32)
            head = bytes((SAMPLE, 0, request))
            numbers = struct.pack("<II", seq, ticks)
            body = frame.body
            if (body[:3], body[4:12], len(body)) != (head, numbers, length):
                expected = (
                    f"{length} bytes: {hexadecimal(head)} .. {hexadecimal(numbers)} ..."
                )
                raise MismatchError(4, expected, hexadecimal(body))

    def _check_end(self, end: Callable[[], object], name: str) -> None:
        """No timed sample may follow an answer that ends the stream."""
        end()
        late = [f for f in self._line.gather(QUIET_S) if f.body[:2] == b"\x83\0"]
        if late:
            raise MismatchError(3, f"no SAMPLE after {name}", described(late))

    def _check_edges(self) -> str | None:
        if not self._known().n_inputs:
            return "it has no inputs"
        if self._press_s is None:
            return "needs an operator: --press SECONDS"
        self._greet(wire.FORGET_EDGES)
        seqs = []
        for level, action in ((1, "press"), (0, "release")):
            self._ask_operator(f"{action} input 0 within {self._press_s:g} s")
            frames = self._line.gather(self._press_s, lambda f: f.body[0] == wire.EDGE)
            length = 12 + 5 * len(self._known().channels)
            edge = frames[-1].body if frames else b""
            if len(edge) != length or edge[:3] != bytes((wire.EDGE, 0, level)):
                expected = f"EDGE of {length} bytes: 84 00 {level:02X} ..."
                raise MismatchError(4, expected, described(frames[-1:]))
            seqs.append(int.from_bytes(edge[4:8], "little"))
            self._check_repeated(seqs[-1], edge)
        if seqs[1] != (seqs[0] + 1) % (1 << 32):
            raise MismatchError(4, f"edge {seqs[0] + 1} next", f"edge {seqs[1]}")
        return None

    def _check_repeated(self, seq: int, edge: bytes) -> None:
        """Require that an edge is repeated unchanged until it is acknowledged."""
        self._check_interval(edge)
        self._acknowledge(seq + 5)  # an edge that the board has not sent
        self._check_interval(edge)
        self._acknowledge(seq)
        self._greet()  # the answer shows that the acknowledgement was read
        repeated = [f for f in self._line.gather(0.5) if f.body[0] == wire.EDGE]
        if repeated:
            expected = f"no edge {hexadecimal(edge[4:8])} after its EDGE_ACK"
            raise MismatchError(3, expected, described(repeated))

    def _check_interval(self, edge: bytes) -> None:
        """Require that an edge is sent every 50 ms.

        Strategy: a busy computer reads late, and then several at once, or runs an
        emulated board late; neither changes the median of ten intervals.
        """
        expected = f"edge {hexadecimal(edge[4:8])} every 50 ms"
        times_ns = []
        for _ in range(11):
            frames = self._line.gather(0.5, lambda f: f.body[0] == wire.EDGE)
            if not frames or frames[-1].body[0] != wire.EDGE:
                raise MismatchError(4, expected, "none in 500 ms")
            if frames[-1].body != edge:
                raise MismatchError(4, hexadecimal(edge), described(frames[-1:]))
            times_ns.append(frames[-1].received_ns)
        interval_ms = 1e-6 * median(later - t for t, later in pairwise(times_ns))
        if not LEAST_AGAIN_MS <= interval_ms <= MOST_AGAIN_MS:
            raise MismatchError(4, expected, f"every {interval_ms:.0f} ms")

    def _acknowledge(self, seq: int) -> None:
        self._line.send(struct.pack("<BI", 6, seq % (1 << 32)))

    def _check_broken(self) -> None:
        if self._line.broken:
            broken = "; ".join(map(hexadecimal, self._line.broken[:3]))
            raise MismatchError(1, "COBS, CRC and 00 of every frame right", broken)
