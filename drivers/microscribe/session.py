"""A signed-on MicroScribe: identity, and packets as samples."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from statistics import median

from traverse.drivers.base.values import (
    STATUS_MISSING,
    STATUS_TIME_UNCERTAIN,
    DeviceError,
    Identity,
    PolledSample,
)
from traverse.drivers.microscribe.line import PACKET_S, MicroscribeLine, TimedPacket
from traverse.drivers.microscribe.packets import PacketClock, timer_runs
from traverse.drivers.polling.channel import IMPLAUSIBLE, EncoderReading, PolledChannel
from traverse.protocol.microscribe import session as wire
from traverse.protocol.microscribe.packets import (
    N_BUTTONS,
    TIMER_WRAP,
    Framing,
    PacketDecoder,
)
from traverse.protocol.microscribe.session import Maxes

BAUD_RATES = (115200, 57600, 38400, 19200, 9600, 28800, 14400)
LOOK_S = 0.06  # to get acquainted
LEAST_PACKETS = 5
LOOKS = 3
SHARE_OF_LINE = 0.8
PATIENCE = 3.0  # times the longest packet so far
SHORTEST_S = 0.02
LEAST_JITTER_NS = 100_000  # a host is not quicker than that
TRIES = 3

QUIET_NS = 250_000_000
CONFIRM_NS = 15_000_000  # the same while a pedal's change waits to be confirmed

OpenLine = Callable[[int], MicroscribeLine]  # at a baud rate


@dataclass(frozen=True, slots=True)
class MicroscribeIdentification:
    """Properties that an arm reports."""

    box: str
    product: str
    model: str
    serial: str
    version: str
    maxes: Maxes
    baud_rate: int

    @property
    def name(self) -> str:
        """For people: product, model and number."""
        words = [self.product or self.box or "MicroScribe", self.model, self.serial]
        return " ".join(filter(None, words))

    @property
    def framing(self) -> Framing:
        return self.maxes.framing

    @property
    def timer_wrap(self) -> int:
        greatest = self.maxes.timer
        return greatest + 1 if 0 < greatest < TIMER_WRAP else TIMER_WRAP

    @property
    def moduli(self) -> tuple[int, ...]:
        """Counts a turn of the encoders that are there, from the base outwards."""
        moduli = [greatest + 1 for greatest in self.maxes.encoders]
        return tuple(moduli[: moduli.index(1)] if 1 in moduli else moduli)

    def decoder(self) -> PacketDecoder:
        return PacketDecoder(self.framing, timer=True)


def read_identification(line: MicroscribeLine, box: str) -> MicroscribeIdentification:
    """Read the identity of an arm.

    Raises:
        DeviceError: it does not answer, or is no MicroScribe.
    """
    maxes = line.maxes()
    return MicroscribeIdentification(
        box=box,
        product=line.text("product"),
        model=line.text("model"),
        serial=line.text("serial"),
        version=line.text("version"),
        maxes=maxes,
        baud_rate=line.baud_rate,
    )


def connect(
    open_line: OpenLine, baud_rate: int, known: MicroscribeIdentification | None
) -> tuple[MicroscribeLine, MicroscribeIdentification, bool]:
    """Sign on, or continue the earlier session if the arm still holds it.

    Returns:
        The line, the arm, and whether its session has continued.

    Raises:
        DeviceError: there is no arm, or none that can be read.
    """
    if known is not None:
        with ExitStack() as closing:
            line = closing.enter_context(open_line(baud_rate))
            line.still()
            decoder = known.decoder()
            if any(line.packet(decoder) for _ in range(TRIES)):
                closing.pop_all()
                return line, known, True
    line, box = sign_on_at_any_rate(open_line, [baud_rate])
    with ExitStack() as closing:
        closing.enter_context(line)
        arm = read_identification(line, box)
        closing.pop_all()
    return line, arm, False


def sign_on_at_any_rate(
    open_line: OpenLine, rates: Sequence[int]
) -> tuple[MicroscribeLine, str]:
    path = ""
    remaining_rates = [rate for rate in BAUD_RATES if rate not in rates]
    for rate in [*rates, *remaining_rates, *rates[:1]]:
        with ExitStack() as closing:
            line = closing.enter_context(open_line(rate))
            path = line.port.path
            if rate not in rates:  # a session left there receives nothing but this
                line.end()
                line.read_until_quiet()
            elif (greeting := line.sign_on()) is not None:
                closing.pop_all()
                return line, greeting
    raise DeviceError(
        f"no MicroScribe answers on {path} at {', '.join(map(str, rates))} baud",
        "switch the arm on in its home position, check cable and port",
    )


class MicroscribeSession:
    """Packets of one arm on one line, checked.

    A ``timer_rate_hz`` of 0 leaves the timer unused.

    Attributes:
        reached_hz: rate at which packets can be requested.
        delay_ns: least time from the latch to the first bytes of a packet.
        first: the last sample before the requested ones.
        timer_used: the arm's timer runs as it should.
    """

    def __init__(
        self,
        line: MicroscribeLine,
        arm: MicroscribeIdentification,
        timer_rate_hz: float,
        max_speed_rad_s: float,
        monotonic_ns: Callable[[], int],
    ) -> None:
        self.line, self.arm = line, arm
        self.channels = [
            PolledChannel(
                *(f"encoder {number}", modulus, modulus, max_speed_rad_s),
                is_checked=False,
            )
            for number, modulus in enumerate(self.arm.moduli)
        ]
        self.decoder: PacketDecoder = self.arm.decoder()
        self._now_ns = monotonic_ns
        self._n_spoilt = 0
        self.clock = PacketClock(0.0, 1, 0)
        wrap, self.timer_used = self.arm.timer_wrap, False
        for _ in range(LOOKS):  # one of them may fall into a stall of the host
            packets, lengths_ns = self._look()
            if timer_rate_hz > 0:
                self.timer_used = timer_runs(packets, timer_rate_hz, wrap)
            if self.timer_used or timer_rate_hz <= 0:
                break
            self.line.read_until_quiet(PACKET_S)
        quickest = min(packets, key=lambda packet: packet.begun_ns - packet.sent_ns)
        self.delay_ns = quickest.delay_ns
        self._n_spoilt = self._n_spoilt_bytes()
        used_hz = timer_rate_hz if self.timer_used else 0.0
        self.clock = PacketClock(used_hz, wrap, self.delay_ns)
        self.first = [self.sample_of(packet)[0] for packet in packets][-1]
        if self.timer_used:  # which identifies an answer that arrives later than that
            usual_s = PATIENCE * max(lengths_ns) * 1e-9
            patience_s = min(max(usual_s, SHORTEST_S), PACKET_S)
            self.line.patience_s = self.line.usual_patience_s = patience_s
        self.reached_hz = SHARE_OF_LINE * 1e9 / max(1.0, median(lengths_ns))
        # What is not known to be time on the line may have been on either way.
        unknown_ns = quickest.begun_ns - quickest.sent_ns - quickest.delay_ns
        self._jitter_ns = max(unknown_ns, LEAST_JITTER_NS)

    @property
    def identity(self) -> Identity:
        return Identity(
            self.arm.name,
            self.arm.version,
            self.arm.moduli,
            N_BUTTONS,
            self.reached_hz,
            latches=False,
            counts_per_turn=self.arm.moduli,
            jitter_ns=self._jitter_ns,
            absolute=False,
            serials=(self.arm.serial,),
        )

    def ask(self) -> TimedPacket | None:
        """Request a packet; None if none arrives."""
        return self.line.packet(self.decoder, self.clock.is_old)

    def sample_of(self, timed: TimedPacket) -> tuple[PolledSample, list[int]]:
        """Convert a packet to a sample; return also channels with impossible counts."""
        ticks, time_ns = self.clock.time_of(timed)
        uncertain = STATUS_TIME_UNCERTAIN if self.clock.is_uncertain else 0
        status, implausible = [], []
        if (n_spoilt := self._n_spoilt_bytes()) > self._n_spoilt:
            self._n_spoilt = n_spoilt
            for channel in self.channels:
                channel.doubt(timed.received_ns)
        for number, channel in enumerate(self.channels):
            count, bound_ns = timed.packet.encoders[number], self.clock.bound_ns
            reading = EncoderReading(count, time_ns, bound_ns=bound_ns)
            possible = reading.count < channel.modulus
            miss = channel.accept(reading if possible else IMPLAUSIBLE, time_ns)
            if miss is IMPLAUSIBLE:
                implausible.append(number)
            status.append(STATUS_MISSING if miss else uncertain)
        if doubts := self.doubts(timed.received_ns):
            status = [bits | doubts for bits in status]  # one packet has them all
        sample = PolledSample(
            time_ns,
            timed.received_ns,
            ticks,
            timed.packet.buttons,
            tuple(channel.count for channel in self.channels),
            tuple(status),
            time_bound_ns=self.clock.bound_ns,
        )
        return sample, implausible

    def doubts(self, now_ns: int) -> int:
        """Return the current marks of all readings, bits ``STATUS_*``."""
        return max(channel.status(now_ns) for channel in self.channels)

    def _n_spoilt_bytes(self) -> int:
        """How often bytes had changed; a packet that lacks some always shows it."""
        return self.decoder.faults["foreign"]

    def _look(self) -> tuple[list[TimedPacket], list[int]]:
        """Request packets for a while; return them and their durations [ns]."""
        packets: list[TimedPacket] = []
        missed = 0
        until_ns = self._now_ns() + int(LOOK_S * 1e9)
        while self._now_ns() < until_ns or len(packets) < LEAST_PACKETS:
            if (packet := self.ask()) is not None:
                packets.append(packet)
                continue
            missed += 1
            if missed == TRIES:
                break
            # An answer that is late would be taken for that of the next request.
            self.line.read_until_quiet(PACKET_S)
        if not packets:
            raise DeviceError(
                f"{self.arm.name} on {self.line.port.path} sends no packets",
                "switch it off and on again in its home position",
            )
        return packets, [packet.received_ns - packet.sent_ns for packet in packets]


class MotionReport:
    """Packets that the arm sends by itself, on changes.

    A quiet arm looks like a dead one. After a silence the report is therefore ended,
    one packet is requested, and the report begins again.
    """

    def __init__(
        self,
        session: MicroscribeSession,
        delay_ms: int,
        monotonic_ns: Callable[[], int],
    ) -> None:
        self._line = session.line
        self._delay_ns = session.delay_ns
        self._decoder = session.decoder
        self._now_ns = monotonic_ns
        framing = session.arm.framing
        self._request = wire.motion_request(framing, delay_ms, timer=True)
        self._running = self._unechoed = False
        self._begun_ns = self._last_ns = monotonic_ns()

    def begin(self) -> None:
        self._line.port.write(self._request)
        self._running = self._unechoed = True
        self._begun_ns = self._last_ns = self._now_ns()

    def end(self) -> None:
        if self._running:
            self._running = False
            # The rest of a packet that has begun, too: it is not broken.
            self._decoder.feed(self._without_echo(self._line.still()))

    def read(self, seconds: float) -> list[TimedPacket]:
        """Return the next packets, none after a time without any."""
        if not self._line.port.wait(seconds):
            return []
        begun_ns = self._now_ns()
        packets = self._decoder.feed(self._without_echo(self._line.port.read()))
        received_ns = self._now_ns()
        if packets:
            self._last_ns = received_ns
        return [
            TimedPacket(
                *(packet, self._begun_ns, begun_ns, received_ns, self._delay_ns),
                is_reported=True,
            )
            for packet in packets
        ]

    def is_quiet(self, *, unsettled: bool) -> bool:
        patience_ns = CONFIRM_NS if unsettled else QUIET_NS
        return self._now_ns() - self._last_ns > patience_ns

    def _without_echo(self, data: bytes) -> bytes:
        echo = bytes([wire.MOTION])
        if not self._unechoed or echo not in data:
            return data
        self._unechoed = False
        return data.replace(echo, b"", 1)
