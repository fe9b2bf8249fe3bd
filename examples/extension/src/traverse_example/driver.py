r"""Driver of a hub whose encoders are read one after the other, in ASCII.

request   "r<channel>\n"
reply     "<count in hex> <sum of the count's bytes, modulo 256, in hex>\n"
"""

from collections.abc import Sequence

from pydantic import Field

from traverse.drivers.base.values import DeviceError
from traverse.drivers.io.ports import BytePort
from traverse.drivers.polling.channel import EncoderReading, PolledChannel, ReadError
from traverse.drivers.polling.polled_driver import PolledDriver, PolledOptions

SILENT = ReadError("silent", "does not answer", "check power and cable")
SPOILT = ReadError(
    "spoilt", "answers with a wrong sum", "check cable and shielding", is_damage=True
)


class AsciiHubOptions(PolledOptions):
    """Keys of the driver; channel i is encoder i of ``counts_per_turn``."""

    port: str = Field(min_length=1)
    baud_rate: int = Field(default=115_200, ge=1200, le=1_000_000)
    counts_per_turn: tuple[int, ...] = Field(min_length=1, max_length=32)
    answer_timeout_s: float = Field(default=0.05, ge=0.005, le=5.0)
    max_rate_hz: float = Field(default=500.0, ge=1.0, le=2000.0)


class HubLine:
    """The line to the hub."""

    def __init__(self, port: BytePort) -> None:
        self.port = port
        self.unrequested_bytes = 0

    def close_port(self) -> None:
        self.port.close()

    def discard(self) -> None:
        """Discard bytes that came without a request, or too late for it."""
        while self.port.wait(0.0):
            self.unrequested_bytes += len(self.port.read())


class AsciiHubDriver(PolledDriver[HubLine]):
    """Encoders behind one hub."""

    options: AsciiHubOptions
    options_class = AsciiHubOptions

    def _open(self) -> tuple[str, Sequence[PolledChannel]]:
        options = self.options
        self._line = HubLine(
            self._ports.open(options.port, options.baud_rate, self._wake_read)
        )
        channels = [
            PolledChannel(f"encoder {channel}", counts, counts, options.max_speed_rad_s)
            for channel, counts in enumerate(options.counts_per_turn)
        ]
        return f"hub on {options.port}", channels

    def _read_channel(self, channel: int) -> EncoderReading | ReadError:
        line = self._open_line
        line.discard()
        sent_ns = self._now_ns()
        line.port.write(b"r%d\n" % channel)
        reply = self._reply(sent_ns)
        if reply is None:
            return SILENT
        count = parse_reply(reply)
        if count is None or count >= self.options.counts_per_turn[channel]:
            return SPOILT
        # The hub reads somewhere between request and reply.
        half_ns = (self._now_ns() - sent_ns) // 2
        return EncoderReading(count, sent_ns + half_ns, bound_ns=half_ns)

    def _reply(self, sent_ns: int) -> bytes | None:
        """Return the bytes before the end of a line; None if it does not come in time.

        Raises:
            DeviceError: the hub sends without end.
        """
        until_ns = sent_ns + round(self.options.answer_timeout_s * 1e9)
        received = b""
        while b"\n" not in received:
            left_ns = until_ns - self._now_ns()
            if left_ns <= 0:
                return None
            if self._open_line.port.wait(left_ns * 1e-9):
                received += self._open_line.port.read()
            if len(received) > 64:
                raise DeviceError("it sends more than it was asked for", "check baud")
        return received.partition(b"\n")[0]


def parse_reply(reply: bytes) -> int | None:
    """Return the count of a reply; None if it is not one, or its sum is wrong."""
    try:
        count, total = (int(word, 16) for word in reply.split(b" "))
        sum_of_bytes = sum(count.to_bytes(4, "big")) % 256
    except (ValueError, OverflowError):
        return None
    return count if sum_of_bytes == total else None
