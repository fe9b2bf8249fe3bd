"""The compiled core, spoken to in bodies; time is passed in ticks."""

import ctypes

from tests.firmware.built import bench_library
from tests.protocol.latch_board_frames import crc_bit_by_bit, framed

MOST_SENT = 60_000


def opened(segment: bytes) -> bytes:
    """Return the body between two delimiters, by the definition of COBS."""
    content, position = bytearray(), 0
    while position < len(segment):
        content += segment[position + 1 : position + segment[position]]
        position += segment[position]
        content += b"\0" if position < len(segment) else b""
    body, crc = bytes(content[:-2]), int.from_bytes(content[-2:], "little")
    assert crc_bit_by_bit(body) == crc, segment.hex(" ")
    return body


class CoreBench:
    def __init__(self, *, rate_hz=1_000_000, first_ticks=0, channels=2, temperatures=2):
        self._core = ctypes.CDLL(str(bench_library()))
        self._core.bench_advance.argtypes = (ctypes.c_uint64, ctypes.c_uint32)
        self._core.bench_power_up(
            rate_hz, ctypes.c_uint32(first_ticks), channels, temperatures
        )

    def wire(self, data: bytes) -> bytes:
        self._core.bench_receive(data, len(data))
        return self._sent_bytes()

    def ask(self, body: str) -> list[str]:
        return shown(self._bodies(self.wire(framed(bytes.fromhex(body)))))

    def after(
        self, n_ticks: int, kind: int | None = None, *, poll_every: int = 1000
    ) -> list[bytes]:
        """Let ticks pass; return bodies that it sends, of one type.

        Args:
            poll_every: interval of the main loop; 0: once, at the end.
        """
        self._core.bench_advance(n_ticks, poll_every)
        assert self._core.bench_n_locked() == 0
        bodies = self._bodies(self._sent_bytes())
        return [body for body in bodies if kind in (None, body[0])]

    def inputs(self, levels: int, after_ticks: int = 0) -> None:
        self._core.bench_inputs(after_ticks, levels)

    def room(self, n_bytes: int) -> None:
        self._core.bench_set_room(n_bytes)

    def latch_takes(self, n_ticks: int) -> None:
        self._core.bench_set_latch_takes(n_ticks)

    def host_gone(self) -> None:
        self._core.bench_host_gone()

    def alarm(self, channel: int, state: int, code: int, value: int) -> bool:
        return bool(self._core.bench_alarm(channel, state, code, value))

    def _sent_bytes(self) -> bytes:
        sent = ctypes.create_string_buffer(MOST_SENT)
        n_bytes = self._core.bench_take(sent)
        return sent.raw[:n_bytes]

    @staticmethod
    def _bodies(sent: bytes) -> list[bytes]:
        assert sent[-1:] in (b"", b"\0")
        return [opened(segment) for segment in sent.split(b"\0")[:-1]]


def shown(bodies: list[bytes]) -> list[str]:
    return [body.hex(" ").upper() for body in bodies]
