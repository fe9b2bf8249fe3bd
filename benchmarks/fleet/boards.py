"""Many boards in one process: `python -m benchmarks.fleet.boards FOLDER N`.

Each is on a pty of its own, FOLDER/<number>/board.pty, and streams slowly turning
counts at the rate that its daemon requests.
"""

import os
import select
import time
from pathlib import Path

import numpy as np

from benchmarks.tools.command_line import run_main
from benchmarks.tools.edge_board import COUNTS, STATUS, EdgeBoard
from traverse.simulator.devices.latch_board import wire

BEAT_NS = 500_000_000
TURN_COUNTS = 50  # in a sample


class Board(EdgeBoard):
    """One of many boards, whose button is never pressed."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, ("1",))

    @property
    def line(self) -> int:
        return self._port

    def due_ns(self) -> int:
        request, period_ns, begun_ns = self._stream
        if not request:
            return self._beat_ns
        return min(self._beat_ns, begun_ns + self._sample_seq * period_ns)

    def serve(self, now_ns: int) -> None:
        request, period_ns, begun_ns = self._stream
        if request:
            n = (now_ns - begun_ns) // period_ns + 1 - self._sample_seq
            if n > 0:
                self._send_samples(request, int(n))
        if now_ns >= self._beat_ns:
            self._beat_ns = now_ns + BEAT_NS
            self._send_heartbeat()

    def serve_requests(self) -> None:
        self._receive(os.read(self._port, 4096))

    def _send_samples(self, request: int, n: int) -> None:
        _, period_ns, begun_ns = self._stream
        seqs = self._sample_seq + np.arange(n)
        ticks = (begun_ns + seqs * period_ns - self._start_ns) // 1000
        counts = COUNTS + (seqs[:, np.newaxis] * TURN_COUNTS % 1_000_000)
        frames = wire.samples(
            0,
            request,
            0,
            seqs=seqs.astype(np.uint32),
            ticks=(ticks % 2**32).astype(np.uint32),
            counts=counts.astype(np.uint32),
            status=np.tile(STATUS, (n, 1)),
        )
        os.write(self._port, b"".join(frames))
        self._sample_seq += n


def main(folder: Path, n: int) -> None:
    boards = {}
    for k in range(n):
        board = Board(folder / str(k) / "board.pty")
        boards[board.line] = board
    while True:
        now_ns = time.monotonic_ns()
        for board in boards.values():
            if board.due_ns() <= now_ns:
                board.serve(now_ns)
        next_ns = min(board.due_ns() for board in boards.values())
        wait_s = max(0.0, (next_ns - time.monotonic_ns()) * 1e-9)
        for line in select.select(list(boards), [], [], wait_s)[0]:
            boards[line].serve_requests()


if __name__ == "__main__":
    run_main(main)
