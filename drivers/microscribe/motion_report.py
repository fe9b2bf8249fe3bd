"""Packets that a MicroScribe sends by itself, whenever something has changed.

While nothing changes nothing is sent, and a quiet arm looks like a dead one.
So after a while of silence the report is ended, one packet is requested, and
the report begins again.
"""

from collections.abc import Callable

from traverse.drivers.microscribe.line import TimedPacket
from traverse.drivers.microscribe.session import MicroscribeSession
from traverse.protocol.microscribe import session as wire

QUIET_NS = 250_000_000
CONFIRM_NS = 15_000_000  # the same while a pedal's change waits to be confirmed


class MotionReport:
    """A report of motion on a line.

    Args:
        session: with the arm.
        delay_ms: the arm waits so long between packets.
        monotonic_ns: the host's clock.
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
        """Make the arm report from now on."""
        self._line.port.write(self._request)
        self._running = self._unechoed = True
        self._begun_ns = self._last_ns = self._now_ns()

    def end(self) -> None:
        """Stop its reports."""
        if self._running:
            self._running = False
            self._line.still()

    def read(self, seconds: float) -> list[TimedPacket]:
        """The next packets, none after a time without any."""
        if not self._line.port.wait(seconds):
            return []
        begun_ns = self._now_ns()
        packets = self._decoder.feed(self._without_echo(self._line.port.read()))
        received_ns = self._now_ns()
        if packets:
            self._last_ns = received_ns
        return [
            TimedPacket(packet, self._begun_ns, begun_ns, received_ns, self._delay_ns)
            for packet in packets
        ]

    def is_quiet(self, *, unsettled: bool) -> bool:
        """Whether a request is due."""
        patience_ns = CONFIRM_NS if unsettled else QUIET_NS
        return self._now_ns() - self._last_ns > patience_ns

    def _without_echo(self, data: bytes) -> bytes:
        """What is read, without the echo of the request."""
        echo = bytes([wire.MOTION])
        if not self._unechoed or echo not in data:
            return data
        self._unechoed = False
        return data.replace(echo, b"", 1)
