"""The host's end of a latch board's line for its tester: whole frames, as they came."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

from traverse.drivers.io.serial_port import SerialPort
from traverse.protocol.latch_board.framing import FrameSplitter, encode_frame

ANSWER_S = 0.5  # waited for an answer, which is due within 0.1 s
ON_REQUEST = 1  # cause of a SAMPLE


@dataclass(frozen=True, slots=True)
class ReceivedFrame:
    """A valid frame: its bytes on the line, its body, when it was read."""

    data: bytes
    body: bytes
    received_ns: int


class MismatchError(Exception):
    """The board does something else than the protocol says.

    Args:
        section: of docs/serial-protocol.md.
        expected: bytes in hexadecimal, or words.
        came: bodies of frames, in hexadecimal, or words.
    """

    def __init__(self, section: int, expected: str, came: str) -> None:
        super().__init__(f"expected {expected}, came {came}")
        self.section, self.expected, self.came = section, expected, came


def hexadecimal(data: bytes) -> str:
    return data.hex(" ").upper()


def described(frames: list[ReceivedFrame]) -> str:
    shown = [hexadecimal(frame.body) for frame in frames[:4]]
    if len(frames) > len(shown):
        shown.append(f"and {len(frames) - len(shown)} more")
    return "; ".join(shown) or "nothing"


class ConformanceLine:
    """Frames of one board.

    Attributes:
        broken: segments that were no valid frame.
    """

    def __init__(self, port: SerialPort) -> None:
        self._port = port
        self._rest = b""
        self._numbers = count(1)
        self.broken: list[bytes] = []

    def request_number(self) -> int:
        return (next(self._numbers) - 1) % 255 + 1

    def write(self, data: bytes) -> None:
        self._port.write(data)

    def send(self, body: bytes) -> None:
        self._port.write(encode_frame(body))

    def gather(
        self,
        seconds: float,
        enough: Callable[[ReceivedFrame], bool] = lambda _frame: False,
    ) -> list[ReceivedFrame]:
        """Read for a time, or until a frame is enough, which is then the last one."""
        frames: list[ReceivedFrame] = []
        until_s = time.monotonic() + seconds
        while True:
            while b"\0" in self._rest:
                segment, _, self._rest = self._rest.partition(b"\0")
                frame = self._opened(segment)
                if frame is not None:
                    frames.append(frame)
                    if enough(frame):
                        return frames
            left_s = until_s - time.monotonic()
            if left_s <= 0.0:
                return frames
            if self._port.wait(left_s):
                self._rest += self._port.read()

    def ask(self, request: int, body: bytes) -> list[ReceivedFrame]:
        self.send(body)
        last = self.gather(ANSWER_S, lambda frame: is_answer(frame, request))
        return [frame for frame in last if is_answer(frame, request)]

    def _opened(self, segment: bytes) -> ReceivedFrame | None:
        if not segment:
            return None
        data = segment + b"\0"
        bodies = FrameSplitter().feed(data)
        if not bodies:
            self.broken.append(data)
            return None
        return ReceivedFrame(data, bodies[0], time.monotonic_ns())


def is_answer(frame: ReceivedFrame, request: int) -> bool:
    body = frame.body
    match body[0]:
        case 0x81:
            return body[1:2] == bytes((request,))
        case 0x82:
            return body[2:3] == bytes((request,))
        case 0x83:
            return body[1:3] == bytes((ON_REQUEST, request))
    return False
