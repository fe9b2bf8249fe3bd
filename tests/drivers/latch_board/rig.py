import asyncio
import contextlib
from collections.abc import Iterator
from pathlib import Path

from tests.drivers.latch_board import frame_bodies as bodies
from tests.drivers.latch_board.fake_board import FakeBoard
from tests.protocol.latch_board_frames import framed
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.latch_board.driver import LatchBoardDriver, LatchBoardOptions


class LatchBoardRig:
    def __init__(self, board: FakeBoard) -> None:
        self.board = board
        self.port = str(board.link)
        self.delivery_queue = DeliveryQueue(asyncio.get_running_loop())
        self.driver = LatchBoardDriver(
            "base", LatchBoardOptions(port=self.port), self.delivery_queue
        )
        self._last: list[bytes] = []
        self._broken = False

    def emit(self, n):
        self._last = self.board.emit(n)

    def lose(self, n):
        self.board.samples(n)

    def press(self):
        if not self._broken:
            return self.board.press()
        self._broken = False
        self.board.repeats_edges = False
        seq = self.board.press()
        spoilt = bytearray(framed(self.board.edges[seq]))
        spoilt[5] ^= 0x40
        later = self.board.next_edge
        overtaking = bodies.edge(0, 0, later, self.board.ticks(), self.board.counts)
        self.board.send_bytes(bytes(spoilt))
        self.board.send(overtaking)
        self.board.repeats_edges = True
        return seq

    def break_next(self):
        self._broken = True

    def repeat_last_samples(self):
        self.board.send(*self._last)

    def unacknowledged(self):
        return set(self.board.edges)

    def unplug(self):
        self.board.unplug()

    def plug(self):
        self.board.plug()


@contextlib.contextmanager
def board_rig(folder: Path) -> Iterator[LatchBoardRig]:
    with FakeBoard(folder / "ttyBoard") as board:
        rig = LatchBoardRig(board)
        try:
            yield rig
        finally:
            rig.driver.close()
