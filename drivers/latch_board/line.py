"""The line to a latch board: answered requests, decoded reads."""

import re
import time
from collections.abc import Callable, Sequence

from traverse.drivers.base.values import DeviceError, DeviceRefusedError
from traverse.drivers.io.serial_port import SerialPort
from traverse.protocol.latch_board import messages as wire
from traverse.protocol.latch_board.framing import MAX_SEGMENT

ANSWER_S = 0.25  # the board answers within 0.1 s
TRIES = 8
SILENCE_S = 2.0  # four heartbeats

MOST_BYTES = 16_384
FAST_NS, PAUSE_S = 750_000, 0.0005  # reads this near to each other are rarer after it
# A whole frame of anything but a timed sample.
_OTHER = re.compile(rb"(?:\A|\0)(?!%b)[^\0]+\0" % re.escape(wire.TIMED))

PartialReads = Sequence[tuple[int, int]]
"""Reads that ended in the midst of a block: its last row there, and the time."""

Response = wire.Hello | wire.Reply | wire.Latched


class LatchBoardLine:
    """One connection to a board, from opening the port to losing it.

    Args:
        port: open port; closed by its owner.
        dispatch: called with every message, answers included, the time right after
            its read, and the block of samples from earlier reads.
        stopping: polled between waits; True ends an unanswered request.

    Attributes:
        last_message_ns: when the last message was read.
        repeated: requests sent again for lack of an answer.
    """

    def __init__(
        self,
        port: SerialPort,
        monotonic_ns: Callable[[], int],
        dispatch: Callable[[wire.Message, int, PartialReads], None],
        stopping: Callable[[], bool],
    ) -> None:
        self.port = port
        self._now_ns = monotonic_ns
        self._dispatch = dispatch
        self._stopping = stopping
        self.decoder = wire.Decoder()
        self.last_message_ns = monotonic_ns()
        self._begun = b""  # of a frame whose end is missing yet
        self._read_ns = 0  # when samples were read last
        self._request = 0
        self._answer: Response | None = None
        self.repeated = 0

    def read(
        self, until_ns: int = 0, meanwhile: Callable[[], int | None] = lambda: None
    ) -> None:
        """Read available bytes and dispatch them.

        Args:
            until_ns: timed samples are collected until then; other messages, above all
                edges, and wake-ups end it.
            meanwhile: called while they are, after each read and at the time that it
                returned last [ns].
        """
        data, received_ns = self.port.read(), self._now_ns()
        reads, n_bytes = [(data, received_ns)], len(data)
        while (
            not self._has_other_frames(data)
            and n_bytes < MOST_BYTES
            and received_ns < until_ns
        ):
            # To wake for each of 10 000 samples a second costs more than to process
            # them: those of a fast stream gather for a while.
            if received_ns - self._read_ns < FAST_NS:
                time.sleep(PAUSE_S)
            self._read_ns = received_ns
            if not self._wait(until_ns, meanwhile):
                break
            try:
                data = self.port.read()
            except DeviceError:
                break  # the next read fails; received messages are processed first
            received_ns = self._now_ns()
            reads.append((data, received_ns))
            n_bytes += len(data)
        before = self.decoder.accepted
        messages = self.decoder.feed(b"".join(data for data, _ in reads))
        if messages:
            self.last_message_ns = received_ns
        earlier = _earlier(reads, self.decoder.accepted - before)
        for message in messages:
            if isinstance(message, Response) and message.request == self._request:
                self._answer = message
            self._dispatch(message, received_ns, earlier)
            earlier = ()  # they are of the first block

    def _wait(self, until_ns: int, meanwhile: Callable[[], int | None]) -> bool:
        """Wait for bytes; False at a time, or after a wake-up without any."""
        while True:
            due_ns = meanwhile() or until_ns
            wait_ns = min(due_ns, until_ns) - self._now_ns()
            if self.port.wait(max(0, wait_ns) * 1e-9):
                return True
            if not due_ns <= self._now_ns() < until_ns:
                return False

    def _has_other_frames(self, data: bytes) -> bool:
        """Return whether bytes hold other frames than samples, which must not wait."""
        joined = self._begun + data
        self._begun = joined.rpartition(b"\0")[2][:MAX_SEGMENT]
        return _OTHER.search(joined) is not None

    def ask(self, name: str, frame: Callable[[int], bytes]) -> Response:
        """Send a request until it is answered; other messages are dispatched meanwhile.

        Each try has a number of its own, so that a late answer is recognised.

        Raises:
            DeviceRefusedError: the board refuses.
            DeviceError: no answer, the port has disappeared, or the driver is closed.
        """
        for attempt in range(TRIES):
            self.repeated += attempt > 0
            self._request = self._request % 255 + 1
            self._answer = None
            self.port.write(frame(self._request))
            until_ns = self._now_ns() + int(ANSWER_S * 1e9)
            while (left_ns := until_ns - self._now_ns()) > 0:
                if self.port.wait(left_ns * 1e-9):
                    self.read()
                if self._stopping():
                    raise DeviceError(
                        f"closed during the request {name}", "start again"
                    )
                if (answer := self._take_answer()) is not None:
                    return self._accepted(answer)
        raise DeviceError(
            f"the board on {self.port.path} does not answer {name}",
            "check power, baud rate, and that this port is a latch board",
        )

    def check_alive(self) -> None:
        """Raise DeviceError when nothing valid has arrived for `SILENCE_S`."""
        silent_s = (self._now_ns() - self.last_message_ns) * 1e-9
        if silent_s > SILENCE_S:
            raise DeviceError(
                f"the board on {self.port.path} has been silent for {SILENCE_S:g} s",
                "check power and cable of the board",
            )

    def _take_answer(self) -> Response | None:
        answer, self._answer = self._answer, None
        return answer

    def _accepted(self, answer: Response) -> Response:
        if isinstance(answer, wire.Reply) and answer.result:
            request_name = wire.REQUEST_NAMES.get(answer.request_type, "a request")
            why = wire.RESULTS.get(answer.result, f"result {answer.result}")
            raise DeviceRefusedError(
                f"the board on {self.port.path} refused {request_name}: {why} "
                f"(value {answer.value})",
                "change the configuration to what the board can do",
            )
        return answer


def _earlier(reads: Sequence[tuple[bytes, int]], accepted: int) -> PartialReads:
    """Return messages of all reads but the last; none if a frame was broken."""
    if len(reads) == 1:
        return ()
    ended, terminators = 0, []
    for data, received_ns in reads[:-1]:
        if n := data.count(0):
            ended += n
            terminators.append((ended - 1, received_ns))
    return terminators if ended + reads[-1][0].count(0) == accepted else ()
