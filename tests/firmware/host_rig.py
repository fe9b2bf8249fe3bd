"""The host's board as a process, its script on a pipe, and a driver on its pty."""

import asyncio
import subprocess
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Self

from tests.firmware.built import host_board
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.latch_board.driver import LatchBoardDriver, LatchBoardOptions


class EmulatedBoard(AbstractContextManager[Any]):
    """A board that a program plays until the block ends; commands are lines to it.

    Attributes:
        link: the path of its port.
        n_edges: how many edges its button has made.
    """

    def __init__(
        self, link: Path, *, program: Sequence[str], ready: str, **options: Any
    ) -> None:
        self.link = link
        self.n_edges = 0
        self._level = 0
        self._process = subprocess.Popen(
            program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, **options
        )
        assert self._answer() == ready

    def ask(self, command: str) -> str:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{command}\n")
        self._process.stdin.flush()
        return self._answer()

    def do(self, *commands: str) -> None:
        for command in commands:
            assert self.ask(command) == "done", command

    def toggle(self) -> int:
        """Press or release the button; return the number that the edge gets."""
        self._level ^= 1
        self.do(f"input 0 {self._level}")
        self.n_edges += 1
        return self.n_edges - 1

    def next_edge(self) -> int:
        return int(self.ask("show").split()[3])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self._process.communicate("quit\n", timeout=10.0)

    def _answer(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().rstrip("\n")


class HostBoard(EmulatedBoard):
    """The program `latch-board`; commands as in ports/host/script.c."""

    def __init__(self, link: Path, *options: str) -> None:
        program = (str(host_board()), "--link", str(link), *options)
        super().__init__(link, program=program, ready=f"ready {link}")


class HostBoardRig:
    """For the contract: encoder 0 counts up by one from sample to sample."""

    def __init__(self, board: EmulatedBoard, debounce_us: int = 0) -> None:
        self.board = board
        self.port = str(board.link)
        self.delivery_queue = DeliveryQueue(asyncio.get_running_loop())
        options = LatchBoardOptions(port=self.port, debounce_us=debounce_us)
        self.driver = LatchBoardDriver("base", options, self.delivery_queue)
        self.turn()

    def turn(self) -> None:
        self.board.do("turn 0 500")

    def emit(self, n):
        """Do nothing: it streams by itself."""

    def lose(self, n):
        self.board.do(f"lose {n}")

    def press(self):
        return self.board.toggle()

    def break_next(self):
        self.board.do(f"spoil {0x84}")

    def unacknowledged(self):
        words = self.board.ask("show").split()
        return set(range(int(words[3]) - int(words[5]), int(words[3])))

    def unplug(self):
        self.board.do("unplug")

    def plug(self):
        self.board.do("plug")
