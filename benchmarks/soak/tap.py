"""`python -m benchmarks.soak.tap BOARD HOST LOG`: a tap on the line of a board.

Passes bytes between the board's pty and one of its own for the daemon, and writes down
which edges the daemon acknowledges. When the board vanishes so does the daemon's pty.
"""

import contextlib
import json
import os
import select
import sys
import time
import tty
from pathlib import Path
from typing import TextIO

from protocol.framing import FrameSplitter
from protocol.latch_board import EDGE_ACK, FORGET_EDGES, HELLO, Decoder, Edge, Hello

READ_BYTES = 65_536
LOOK_MS = 50


class Edges:
    """Edges that the board has sent and the daemon has not acknowledged.

    Args:
        life: of the board.
        log: takes a line for each edge that is acknowledged.
    """

    def __init__(self, life: str, log: TextIO) -> None:
        self._life = life
        self._log = log
        self._waiting: set[int] = set()
        self._is_forgetting = False
        self._from_board = Decoder()
        self._from_host = FrameSplitter()

    def sent(self, data: bytes) -> None:
        """The board has said this."""
        for message in self._from_board.feed(data):
            if isinstance(message, Hello):
                self._is_forgetting = False
            elif isinstance(message, Edge) and not self._is_forgetting:
                self._waiting.add(message.seq)

    def answered(self, data: bytes) -> None:
        """The daemon has said this."""
        for body in self._from_host.feed(data):
            if body[0] == HELLO and body[3] & FORGET_EDGES:
                # A new daemon: they came before its time, also those on their way.
                self._waiting.clear()
                self._is_forgetting = True
                self._write({"hello": self._life})
            elif body[0] == EDGE_ACK:
                last = int.from_bytes(body[1:5], "little")
                for seq in sorted(self._waiting):
                    if seq <= last:
                        self._waiting.remove(seq)
                        self._write({"life": self._life, "seq": seq})

    def _write(self, line: dict[str, object]) -> None:
        line = {"time_s": round(time.time(), 3), **line}
        self._log.write(json.dumps(line) + "\n")
        self._log.flush()


def pass_on(board: int, host: int, edges: Edges) -> None:
    """Pass bytes until the board is gone."""
    poll = select.poll()
    for descriptor in (board, host):
        poll.register(descriptor, select.POLLIN)
    while True:
        ready = dict(poll.poll(10 * LOOK_MS))
        if ready.get(board, 0) & (select.POLLHUP | select.POLLERR):
            return
        if ready.get(board, 0) & select.POLLIN:
            data = os.read(board, READ_BYTES)
            edges.sent(data)
            with contextlib.suppress(BlockingIOError):  # nobody reads: as on a line
                os.write(host, data)
        if ready.get(host, 0) & select.POLLIN:
            data = os.read(host, READ_BYTES)
            edges.answered(data)
            with contextlib.suppress(BlockingIOError):
                os.write(board, data)


def main(board_link: Path, host_link: Path, log_path: Path) -> None:
    """Follow every life of the board."""
    poll = select.poll()
    with log_path.open("a", encoding="utf-8") as log:
        while True:
            poll.poll(LOOK_MS)
            try:
                board = os.open(board_link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            except OSError:
                continue  # it is not there yet
            tty.setraw(board)
            host, slave = os.openpty()
            tty.setraw(slave)
            os.set_blocking(host, False)
            fresh = host_link.with_name(f".{host_link.name}")
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(os.ttyname(slave))
            fresh.rename(host_link)
            life = (board_link.parent / "life").read_text("ascii")
            try:
                pass_on(board, host, Edges(life, log))
            except OSError:
                pass  # the board went in the middle of it
            finally:
                host_link.unlink(missing_ok=True)
                for descriptor in (board, host, slave):
                    os.close(descriptor)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]))
