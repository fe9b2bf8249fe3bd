"""`python -m benchmarks.soak.tap BOARD HOST LOG`: a tap on the line of a board.

Passes bytes between the board's pty and one of its own for the daemon, and writes down
which edges the daemon acknowledges. When the board vanishes so does the daemon's pty.
"""

import contextlib
import json
import os
import select
import sys
import tty
from pathlib import Path
from typing import TextIO

from protocol.framing import FrameSplitter
from protocol.latch_board import EDGE_ACK

READ_BYTES = 65_536
LOOK_MS = 50


def pass_on(board: int, host: int, life: str, log: TextIO) -> None:
    """Pass bytes until the board is gone."""
    splitter = FrameSplitter()
    poll = select.poll()
    for descriptor in (board, host):
        poll.register(descriptor, select.POLLIN)
    while True:
        ready = dict(poll.poll(LOOK_MS * 10))
        if ready.get(board, 0) & (select.POLLHUP | select.POLLERR):
            return
        if ready.get(board, 0) & select.POLLIN:
            data = os.read(board, READ_BYTES)
            with contextlib.suppress(BlockingIOError):  # nobody reads: as on a line
                os.write(host, data)
        if ready.get(host, 0) & select.POLLIN:
            data = os.read(host, READ_BYTES)
            for body in splitter.feed(data):
                if body[0] == EDGE_ACK:
                    seq = int.from_bytes(body[1:5], "little")
                    log.write(json.dumps({"life": life, "seq": seq}) + "\n")
                    log.flush()
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
                pass_on(board, host, life, log)
            except OSError:
                pass  # the board went in the middle of it
            finally:
                host_link.unlink(missing_ok=True)
                for descriptor in (board, host, slave):
                    os.close(descriptor)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]))
