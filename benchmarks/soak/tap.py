"""`python -m benchmarks.soak.tap BOARD HOST LOG`: a tap on the line of a board.

Passes bytes between the board's pty and one of its own for the daemon, and logs the
edges that the daemon acknowledges. When the board vanishes so does the daemon's pty.

A board that is killed leaves its link behind, and the number of its pty is used by the
next program that opens one. So the link is removed as soon as the board is gone, as
udev does, and polled: its target is always the board.
"""

import contextlib
import json
import os
import select
import termios
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from benchmarks.tools.command_line import run_main
from traverse.protocol.latch_board.framing import FrameSplitter
from traverse.protocol.latch_board.messages import (
    EDGE_ACK,
    FORGET_EDGES,
    HELLO,
    Decoder,
    Edge,
    Hello,
)

READ_BYTES = 65_536
LOOK_MS = 50


class Edges:
    """Edges that the board has sent and the daemon has not acknowledged.

    Args:
        log: takes a line for each edge that is acknowledged.
    """

    def __init__(self, life: str, log: TextIO) -> None:
        self._life = life
        self._log = log
        self._waiting: dict[int, float] = {}  # since when
        self._is_forgetting = False
        self._unanswered = 0  # HELLOs that make the board forget its edges
        self._from_board = Decoder()
        self._from_host = FrameSplitter()

    def sent(self, data: bytes) -> None:
        for message in self._from_board.feed(data):
            if isinstance(message, Hello):
                self._is_forgetting = False
                if self._unanswered:  # what arrived earlier is forgotten, too
                    self._unanswered -= 1
                    self._waiting.clear()
            elif isinstance(message, Edge) and not self._is_forgetting:
                self._waiting.setdefault(message.seq, round(time.time(), 3))

    def answered(self, data: bytes) -> None:
        for body in self._from_host.feed(data):
            if body[0] == HELLO and body[3] & FORGET_EDGES:
                # A new daemon: earlier edges are dropped, also those in transit.
                self._waiting.clear()
                self._is_forgetting = True
                self._unanswered += 1
                self._write({"hello": self._life})
            elif body[0] == EDGE_ACK:
                last = int.from_bytes(body[1:5], "little")
                for seq in sorted(self._waiting):
                    if seq <= last:
                        sent_s = self._waiting.pop(seq)
                        line = {"life": self._life, "seq": seq, "sent_s": sent_s}
                        self._write(line)

    def _write(self, line: dict[str, object]) -> None:
        line = {"time_s": round(time.time(), 3), **line}
        self._log.write(json.dumps(line) + "\n")
        self._log.flush()


@dataclass(frozen=True, slots=True)
class Mark:
    """Target and time of a link, which identify a board."""

    target: str
    made_ns: int

    @classmethod
    def of(cls, link: Path) -> "Mark | None":
        """Read the present link; None if there is none."""
        try:
            return cls(str(link.readlink()), link.lstat().st_mtime_ns)
        except OSError:
            return None


def read(line: int) -> bytes:
    try:
        return os.read(line, READ_BYTES)
    except BlockingIOError:
        return b""


def pass_on(board: int, host: int, edges: Edges, is_board: Callable[[], bool]) -> None:
    """Pass bytes until the board is gone, or the opened file is not the board."""
    poll = select.poll()
    for descriptor in (board, host):
        poll.register(descriptor, select.POLLIN)
    while is_board():
        ready = dict(poll.poll(10 * LOOK_MS))
        if ready.get(board, 0) & (select.POLLHUP | select.POLLERR):
            return
        if ready.get(board, 0) & select.POLLIN:
            data = read(board)
            edges.sent(data)
            with contextlib.suppress(BlockingIOError):  # no reader: lost, as on a line
                os.write(host, data)
        if ready.get(host, 0) & select.POLLIN:
            data = read(host)
            edges.answered(data)
            with contextlib.suppress(BlockingIOError):
                os.write(board, data)


def tell(text: str) -> None:
    print(f"{time.time():.3f} {text}", flush=True)


def main(board_link: Path, host_link: Path, log_path: Path) -> None:
    with log_path.open("a", encoding="utf-8") as log:
        while True:
            mark = Mark.of(board_link)
            if mark is None:
                time.sleep(LOOK_MS / 1000)
                continue
            follow(board_link, mark, host_link, log)
            if Mark.of(board_link) == mark:
                board_link.unlink(missing_ok=True)


def follow(board_link: Path, mark: Mark, host_link: Path, log: TextIO) -> None:
    try:
        board = os.open(mark.target, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        tell(f"{mark.target}: {error.strerror}")
        return
    life = (board_link.parent / "life").read_text("ascii")
    host, slave = os.openpty()
    tell(f"board {life} on {mark.target}, host on {os.ttyname(slave)}")
    try:
        tty.setraw(board)
        tty.setraw(slave)
        os.set_blocking(host, False)
        fresh = host_link.with_name(f".{host_link.name}")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(os.ttyname(slave))
        fresh.rename(host_link)
        pass_on(board, host, Edges(life, log), lambda: Mark.of(board_link) == mark)
        tell(f"board {life} gone")
    except (OSError, termios.error) as error:
        tell(f"board {life} gone: {error}")  # in the middle of it
    finally:
        host_link.unlink(missing_ok=True)
        for descriptor in (board, host, slave):
            os.close(descriptor)


if __name__ == "__main__":
    run_main(main)
