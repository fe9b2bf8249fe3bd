"""`python -m benchmarks.tools.edge_board PATH RATE[xN] ...`: presses its button.

Opens a pty, links it to the given path, answers the driver, streams at the
requested rate, presses and releases its button N times at so many a second, at the last
rate for ever. Edges that are not acknowledged are sent again, as the protocol has it,
but none is ever given up. For each press it prints the monotonic time right after the
last byte was written first. The first encoder counts the presses, so that points can be
told apart.
"""

import os
import pty
import select
import sys
import time
import tty
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import repeat
from pathlib import Path

import numpy as np

from benchmarks.tools.command_line import run_main
from traverse.simulator.devices.latch_board import wire

BITS = (23, 23, 23, 23, 22, 22, 22)
IDENTITY = wire.Identity(
    board_id=b"EDGE-BOARD\0\0",
    firmware=(1, 0, 0),
    n_inputs=1,
    n_temperatures=0,
    tick_rate_hz=1_000_000,
    max_rate_millihz=10_000_000,
    boot_id=1,
    bits=BITS,
    moduli=tuple(1 << bits for bits in BITS),
)
COUNTS = np.arange(1, 8, dtype=np.uint32) * 100_000
FIRST_PRESS_NS = 1_000_000_000  # after the stream has begun
AGAIN_NS = 50_000_000
STATUS = np.zeros(7, np.uint8)


class EdgeBoard:
    """The board's side of the line."""

    def __init__(self, path: Path, rates: Sequence[str]) -> None:
        self._port, self._line = pty.openpty()
        tty.setraw(self._line)
        path.unlink(missing_ok=True)
        path.symlink_to(os.ttyname(self._line))
        self._segments = wire.Segments()
        self._start_ns = time.monotonic_ns()
        self._pauses_ns = pauses_ns(rates)
        self._counts = COUNTS.copy()
        self._edge_seq = 0
        self._kept: deque[tuple[int, int, bytes]] = deque()  # number, time sent, frame
        self._stream = (0, 0, 0)  # request, period [ns], begun [ns]
        self._sample_seq = 0
        self._beat_ns = 0

    def run(self) -> None:
        edge_ns = 0
        while True:
            now_ns = time.monotonic_ns()
            request, period_ns, begun_ns = self._stream
            if request and not edge_ns:
                edge_ns = now_ns + FIRST_PRESS_NS
            if edge_ns and now_ns >= edge_ns:
                self._send_edge()
                edge_ns += next(self._pauses_ns)
            if request and now_ns >= begun_ns + self._sample_seq * period_ns:
                self._send_sample(request)
            if self._kept and now_ns >= self._kept[0][1] + AGAIN_NS:
                self._send_again(now_ns)
            if now_ns >= self._beat_ns:
                self._beat_ns = now_ns + 500_000_000
                self._send_heartbeat()
            dues = [self._beat_ns]
            if self._kept:
                dues.append(self._kept[0][1] + AGAIN_NS)
            if edge_ns:
                dues.append(edge_ns)
            if self._stream[0]:
                dues.append(begun_ns + self._sample_seq * period_ns)
            wait_s = max(0.0, (min(dues) - time.monotonic_ns()) * 1e-9)
            if select.select([self._port], [], [], wait_s)[0]:
                self._receive(os.read(self._port, 4096))

    def _ticks(self) -> int:
        return (time.monotonic_ns() - self._start_ns) // 1000 % 2**32

    def _send_edge(self) -> None:
        level = 1 - self._edge_seq % 2
        self._counts[0] = COUNTS[0] + self._edge_seq // 2
        data = wire.edge(
            0,
            level,
            level,
            seq=self._edge_seq,
            ticks=self._ticks(),
            counts=self._counts,
            status=STATUS,
        )
        os.write(self._port, data)
        self._kept.append((self._edge_seq, time.monotonic_ns(), data))
        if level:
            sys.stdout.write(f"{time.monotonic_ns()}\n")
            sys.stdout.flush()
        self._edge_seq += 1

    def _send_again(self, now_ns: int) -> None:
        """Send all edges again that are not acknowledged: the first one was missed."""
        for index, (number, _, data) in enumerate(self._kept):
            os.write(self._port, data)
            self._kept[index] = number, now_ns, data

    def _send_sample(self, request: int) -> None:
        self._write_sample(0, request, self._sample_seq)
        self._sample_seq += 1

    def _send_latched(self, request: int) -> None:
        self._write_sample(1, request, 0)

    def _write_sample(self, cause: int, request: int, seq: int) -> None:
        data = wire.samples(
            cause,
            request,
            0,
            seqs=np.array([seq], np.uint32),
            ticks=np.array([self._ticks()], np.uint32),
            counts=COUNTS[np.newaxis],
            status=STATUS[np.newaxis],
        )
        os.write(self._port, b"".join(data))

    def _send_heartbeat(self) -> None:
        beat = wire.heartbeat(
            1 if self._stream[0] else 0,
            0,
            self._ticks(),
            edges_back=min(255, len(self._kept)),
            next_sample_seq=self._sample_seq,
            next_edge_seq=self._edge_seq,
            tx_dropped=0,
            rx_rejected=0,
        )
        os.write(self._port, beat)

    def _receive(self, data: bytes) -> None:
        for segment in self._segments.feed(data):
            body = wire.body_of(segment)
            if body is None:
                continue
            if body[0] == 6:
                done = int.from_bytes(body[1:5], "little")
                while self._kept and self._kept[0][0] <= done:
                    self._kept.popleft()
                continue
            kind, request = body[0], body[1]
            if kind == 1:
                os.write(self._port, wire.hello(request, IDENTITY))
                self._send_heartbeat()
                continue
            if kind == 5:
                self._send_latched(request)
                continue
            value = int.from_bytes(body[2:6], "little") if kind == 3 else 0
            os.write(self._port, wire.reply(kind, request, 0, value))
            if kind == 3:
                self._stream = (request, 10**12 // value, time.monotonic_ns())
                self._sample_seq = 0


def pauses_ns(rates: Sequence[str]) -> Iterator[int]:
    """Time from each edge to the next; two make a press."""
    for text in rates:
        rate, _, times = text.partition("x")
        period_ns = int(1e9 / float(rate) / 2)
        yield from repeat(period_ns, 2 * int(times)) if times else repeat(period_ns)


def main(path: Path, *rates: str) -> None:
    EdgeBoard(path, rates).run()


if __name__ == "__main__":
    run_main(main)
