"""The line to a MicroScribe: sign-on, identification, packets on request.

The arm detects the baud rate while it waits for sign-on, and then stays at it until the
session ends or it loses power. A session of an earlier program at another rate is ended
first.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self, TypeVar

from traverse.drivers.base.values import DeviceError, DeviceRefusedError
from traverse.drivers.io.serial_port import SerialPort
from traverse.protocol.microscribe import session as wire
from traverse.protocol.microscribe.packets import Packet, PacketDecoder, packet_request

SIGN_ON_S = 1.0
CALL_S = 0.015  # between calls
QUIET_S = 0.03  # longer than an adapter holds bytes back
END_MOTION_S = 0.05  # the arm takes so long to stop
ANSWER_S = 0.3
PACKET_S = 0.1
RELAXED = 0.9  # of the patience after each answer in time
TRIES = 3
MOST_BYTES = 1024

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class TimedPacket:
    """A packet and its times, host monotonic.

    Attributes:
        sent_ns: begin of writing the first request that it may answer; it was latched
            after that.
        begun_ns: read of its first bytes; it was latched before that.
        delay_ns: from the latch to its first bytes, as far as known.
        is_reported: the arm sent it by itself, long after its only request.
    """

    packet: Packet
    sent_ns: int
    begun_ns: int
    received_ns: int
    delay_ns: int
    is_reported: bool = False


class MicroscribeLine:
    """One connection to an arm; a context manager.

    ``stopping`` ends waits.

    Attributes:
        old: packets that answered an earlier request.
        patience_s: time limit of a packet; longer after an answer that came later.
    """

    def __init__(
        self,
        port: SerialPort,
        baud_rate: int,
        monotonic_ns: Callable[[], int],
        stopping: Callable[[], bool],
    ) -> None:
        self.port = port
        self.baud_rate = baud_rate
        self._byte_ns = 1e10 / baud_rate
        self._now_ns = monotonic_ns
        self._stopping = stopping
        self.unrequested_bytes = self.old = 0
        self.patience_s = self.usual_patience_s = PACKET_S
        self._unanswered_ns: list[int] = []  # requests of packets, when sent

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.port.close()

    def sign_on(self) -> str | None:
        """Begin a session; return the kind of interface box, None without an answer."""
        until_ns = self._now_ns() + int(SIGN_ON_S * 1e9)
        received = b""
        while wire.CALL not in received:
            if self._now_ns() >= until_ns:
                return None
            self.port.write(wire.END_SESSION + wire.CALL)
            # An adapter may hold an answer back until after the next call.
            received = received[-len(wire.CALL) :] + self._read_for(CALL_S)
        self.read_until_quiet()
        self.port.write(wire.BEGIN)
        answer = self._wait_for(
            lambda data: None if (end := data.find(0)) < 0 else data[:end], ANSWER_S
        )
        return None if answer is None else wire.plain_text(answer)

    def end(self) -> None:
        self.port.write(wire.END_MOTION + wire.END_SESSION)

    def text(self, name: str) -> str:
        """Return one of the texts; empty if the arm does not know it."""
        command = wire.TEXTS[name]
        text = self._request(command, lambda data: wire.text_reply(command, data))
        return text or ""

    def maxes(self) -> wire.Maxes:
        """Greatest counts.

        Raises:
            DeviceRefusedError: the answer is invalid.
        """
        data = b""
        for _ in range(TRIES):
            self.read_until_quiet()
            self.port.write(bytes([wire.MAXES]))
            data = self._read_for(QUIET_S) + self.read_until_quiet()
            if (maxes := wire.maxes_reply(data)) is not None:
                return maxes
        raise DeviceRefusedError(
            f"the device on {self.port.path} reports its greatest counts as "
            f"{data[:60].hex(' ') or 'nothing'}, which is neither 24 nor 44 bytes",
            "check that this is a MicroScribe that speaks HCI 2 or 3",
        )

    def home(self) -> tuple[int, ...]:
        block = self._request(
            wire.HOME, lambda data: wire.fixed_reply(wire.HOME, wire.HOME_BYTES, data)
        )
        return wire.home_counts(self._required(block, "its home position"))

    def kinematics(self) -> bytes:
        """The block with the arm's own table."""
        block = self._request(
            wire.GEOMETRY, lambda data: wire.counted_reply(wire.GEOMETRY, data)
        )
        return self._required(block, "its own table")

    def still(self) -> bytes:
        """Stop unsolicited packets; return bytes received until then."""
        self.port.write(wire.END_MOTION)
        data = self.read_until_quiet(END_MOTION_S)
        return data.partition(wire.END_MOTION_REPLY)[0]

    def drop_stray(self) -> None:
        while self.port.wait(0.0):
            self.unrequested_bytes += len(self.port.read())

    def packet(
        self,
        decoder: PacketDecoder,
        old: Callable[[TimedPacket], bool] = lambda _: False,
    ) -> TimedPacket | None:
        """Request a packet with timer; None if none arrives.

        ``old`` recognises an answer to an earlier request. What it does not recognise
        may answer any request that was not answered in time.
        """
        self.drop_stray()
        sent_ns = begun_ns = self._now_ns()
        since_ns = sent_ns - int(ANSWER_S * 1e9)
        waiting_ns = [at_ns for at_ns in self._unanswered_ns if at_ns > since_ns]
        self._unanswered_ns = waiting_ns = [*waiting_ns, sent_ns]
        self.port.write(packet_request(timer=True))
        delay_ns = 0
        until_ns = sent_ns + int(self.patience_s * 1e9)
        while (left_ns := until_ns - self._now_ns()) > 0 and not self._stopping():
            if not self.port.wait(left_ns * 1e-9):
                continue
            now_ns = self._now_ns()
            data = self.port.read()
            if not decoder.pending:
                begun_ns = now_ns
                delay_ns = self._delay_ns(data, begun_ns - sent_ns)
            n_spoilt = _n_spoilt(decoder)
            packets = decoder.feed(data)
            # A spoilt answer has had its turn, and does not come later.
            del waiting_ns[: _n_spoilt(decoder) - n_spoilt]
            for packet in packets:
                timed = TimedPacket(packet, sent_ns, begun_ns, self._now_ns(), delay_ns)
                first_ns = waiting_ns.pop(0) if waiting_ns else sent_ns
                if not old(timed):
                    # Else each packet that is spoilt would cost the longest patience.
                    shorter_s = RELAXED * self.patience_s
                    self.patience_s = max(self.usual_patience_s, shorter_s)
                    return replace(timed, sent_ns=first_ns)
                self.old += 1
                self.patience_s = min(2.0 * self.patience_s, PACKET_S)
        return None

    def read_until_quiet(self, quiet_s: float = QUIET_S) -> bytes:
        """Read until silence, at most some bytes."""
        data = b""
        while (chunk := self._read_for(quiet_s)) and len(data) < MOST_BYTES:
            data += chunk
        return data

    def _delay_ns(self, data: bytes, exchange_ns: int) -> int:
        """Return the time from a latch to the first bytes of its packet.

        Time on the line is known; the rest of the exchange is split evenly.
        """
        wire_ns = round(max(0, len(data) - 1) * self._byte_ns)
        return min((exchange_ns + wire_ns) // 2, exchange_ns)

    def _request(self, command: int, parsed: Callable[[bytes], T | None]) -> T | None:
        for _ in range(TRIES):
            self.drop_stray()
            self.port.write(bytes([command]))
            if (answer := self._wait_for(parsed, ANSWER_S)) is not None:
                return answer
        return None

    def _required(self, answer: bytes | None, quantity: str) -> bytes:
        if answer is None:
            raise DeviceError(
                f"the device on {self.port.path} does not report {quantity}",
                "check the cable, and that no other program uses the port",
            )
        return answer

    def _wait_for(
        self, parsed: Callable[[bytes], T | None], seconds: float
    ) -> T | None:
        until_ns = self._now_ns() + int(seconds * 1e9)
        data = b""
        while (left_ns := until_ns - self._now_ns()) > 0 and len(data) < MOST_BYTES:
            if self._stopping():
                break
            if self.port.wait(left_ns * 1e-9):
                data += self.port.read()
                if (answer := parsed(data)) is not None:
                    return answer
        return None

    def _read_for(self, seconds: float) -> bytes:
        """Read for a time; a request to stop ends it with DeviceError."""
        until_ns = self._now_ns() + int(seconds * 1e9)
        data = b""
        while (left_ns := until_ns - self._now_ns()) > 0:
            if self._stopping():
                raise DeviceError("closed during a request", "start again")
            if self.port.wait(left_ns * 1e-9):
                data += self.port.read()
        return data


def _n_spoilt(decoder: PacketDecoder) -> int:
    return decoder.faults["broken"] + decoder.faults["foreign"]
