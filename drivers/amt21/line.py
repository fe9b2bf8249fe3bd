"""An RS-485 line with AMT21 encoders: one request, one reply at a time.

A reply carries no address. After unexpected bytes the line is therefore given time to
become quiet, and the reader learns that replies may have been shifted from one encoder
to the next.
"""

from collections.abc import Callable, Sequence

from traverse.drivers.base.values import DeviceError
from traverse.drivers.io.ports import BytePort
from traverse.drivers.polling.channel import EncoderReading, ReadError
from traverse.plurals import counted
from traverse.protocol import amt21

ECHO_TRIES = 4
LEAD = 2  # required majority of the tries
LATE_REPLIES = 4  # quiet times after which none is on its way any more
MOST_SETTLING = 10  # quiet times: a line that is never quiet is not waited for
AVERAGED = 16  # exchanges

SILENT = ReadError(
    "silent", "does not answer", "check its power, its wires and its address"
)
SHORT = ReadError(
    "short",
    "answers with too few bytes",
    "check cable and termination; the adapter's echo may have changed",
)
SLOW = ReadError(
    "slow",
    "answers too late to know when it was read",
    "set the adapter's latency timer to 1 ms, relieve this machine of other work",
)
GARBLED = ReadError(
    "garbled",
    "answers with wrong check bits",
    "check cable, shielding, baud rate and that no address is used twice",
    is_damage=True,
)


class Amt21Line:
    """The line, from opening the port to losing it.

    Args:
        port: open port; closed by its owner.
        timeout_s: for an answer through this adapter; half of it bounds the error of
            an answer's time.
        echoed: the adapter echoes requests; see `find_echo`.

    Attributes:
        exchange_ns: mean duration of an exchange.
        unrequested_bytes: unexpected bytes, late replies among them.
    """

    def __init__(
        self,
        port: BytePort,
        monotonic_ns: Callable[[], int],
        timeout_s: float,
        *,
        echoed: bool = False,
    ) -> None:
        self._port = port
        self._now_ns = monotonic_ns
        self._timeout_ns = round(timeout_s * 1e9)
        self.echoed = echoed
        self.exchange_ns = 0.0
        self.longest_ns = 0
        self.unrequested_bytes = 0
        self._disturbed = False
        self._missed = False

    def close_port(self) -> None:
        self._port.close()

    def find_echo(self, addresses: Sequence[int]) -> None:
        """Determine whether the adapter echoes.

        Raises:
            DeviceError: nothing is received, or it is ambiguous.
        """
        heard_any = b""
        votes = 0
        for number in range(ECHO_TRIES * len(addresses)):
            request = amt21.position_request(addresses[number % len(addresses)])
            if self._port.wait(0.0):  # a late reply would be taken for the next one
                heard_any += self._until_quiet(LATE_REPLIES * self._timeout_ns)
            self._port.write(request)
            received = self._until_quiet(self._timeout_ns)
            heard_any += received
            says = amt21.echo_heard(request, received)
            votes += 0 if says is None else 1 if says else -1
            if abs(votes) == LEAD:
                self.echoed = votes > 0
                return
        if heard_any:
            raise DeviceError(
                "cannot determine whether the adapter echoes what is sent: replies are "
                f"not those of an AMT21 (it began with {heard_any[:8].hex(' ')})",
                'check baud rate and wiring, or set echo = "yes" or "no"',
            )
        raise DeviceError(
            f"nothing answers at {counted(len(addresses), 'address')}",
            "check power, wires A and B, addresses and baud rate",
        )

    def ask(
        self, request: bytes, *, patient: bool = True
    ) -> EncoderReading | ReadError:
        """Send a request and wait for its reply.

        Unless ``patient`` it waits only as long as most replies take.

        Raises:
            DeviceError: the port has disappeared.
        """
        timeout_ns = self._timeout_ns if patient else self._usual_ns()
        self._clear(timeout_ns)
        reply = amt21.Reply(request, echoed=self.echoed)
        sent_ns = received_ns = self._now_ns()
        self._port.write(request)
        is_complete = False
        while not is_complete and (left_ns := sent_ns + timeout_ns - received_ns) > 0:
            if self._port.wait(left_ns * 1e-9):
                is_complete = reply.feed(self._port.read())
            received_ns = self._now_ns()
        if reply.surplus:
            self._count_unrequested(reply.surplus, timeout_ns)
        if reply.value is None:
            return self._failed(reply, is_complete, timeout_ns)
        self._learn(received_ns - sent_ns)
        if received_ns - sent_ns > timeout_ns:  # it was there, but was not read
            return SLOW
        half_ns = (received_ns - sent_ns) // 2
        return EncoderReading(reply.value, sent_ns + half_ns, bound_ns=half_ns)

    def command(self, request: bytes) -> None:
        """Send a command without reply, and discard input."""
        self._port.write(request)
        self._until_quiet(self._timeout_ns)

    def take_validity(self) -> bool:
        """Whether since the last call every answer was from the encoder requested."""
        if self._missed:
            # The reply that timed out may still arrive, or have displaced others.
            if late := self._until_quiet(self._usual_ns()):
                self.unrequested_bytes += len(late)
                self._disturbed = True
        else:
            self._clear(self._timeout_ns)
        sound = not self._disturbed
        self._disturbed = self._missed = False
        return sound

    def _failed(
        self, reply: amt21.Reply, is_complete: bool, timeout_ns: int
    ) -> ReadError:
        self._missed = True
        quiet_ns = min(timeout_ns, self._usual_ns()) if is_complete else timeout_ns
        # What arrives now is this encoder's, and harmless.
        self.unrequested_bytes += len(self._until_quiet(quiet_ns))
        if is_complete:
            return GARBLED
        return SHORT if reply.begun else SILENT

    def _clear(self, quiet_ns: int) -> None:
        if self._port.wait(0.0):
            self._count_unrequested(len(self._port.read()), quiet_ns)

    def _count_unrequested(self, n_bytes: int, quiet_ns: int) -> None:
        self._disturbed = True
        self.unrequested_bytes += n_bytes + len(self._until_quiet(quiet_ns))

    def _until_quiet(self, quiet_ns: int) -> bytes:
        """Read until silence; return the first 64 bytes."""
        received = b""
        begun_ns = quiet_since_ns = self._now_ns()
        while (now_ns := self._now_ns()) - begun_ns < MOST_SETTLING * quiet_ns:
            left_ns = quiet_since_ns + quiet_ns - now_ns
            if left_ns <= 0:
                break
            if self._port.wait(left_ns * 1e-9):
                received = (received + self._port.read())[:64]
                quiet_since_ns = self._now_ns()
        return received

    def _usual_ns(self) -> int:
        """Return a time within which most replies arrive; at first the time-out."""
        if not self.exchange_ns:
            return self._timeout_ns
        return min(self._timeout_ns, round(4 * self.exchange_ns) + 1_000_000)

    def _learn(self, exchange_ns: int) -> None:
        before_ns = self.exchange_ns or exchange_ns
        self.exchange_ns = before_ns + (exchange_ns - before_ns) / AVERAGED
        self.longest_ns = max(self.longest_ns, exchange_ns)
