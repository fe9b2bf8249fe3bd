"""Boards whose processor is emulated, and a driver on their line."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.firmware.host_rig import EmulatedBoard, HostBoardRig
from tests.running import run_traverse
from traverse.drivers.base.values import LatchedCounts
from traverse.testing.driver_contract import up

COUNTS_PER_TURN = 8192


@dataclass(frozen=True, slots=True)
class Press:
    """A change of an input.

    Attributes:
        mark_cycles: processor cycles from it to the mark of its latch.
        counts: what the encoders were at it.
        latch_cycles: cycles to the latch of each encoder that is latched by a line.
    """

    mark_cycles: int
    counts: tuple[int, ...]
    latch_cycles: tuple[int, ...]


class EmulatedProcessor(EmulatedBoard):
    """A board whose processor is emulated, with models of encoders at its pins."""

    def last_press(self) -> "Press":
        """What the emulator knows of the last change of an input."""
        words = self.ask("latency").split()
        end = words.index("channels")
        return Press(
            mark_cycles=int(words[1]),
            counts=tuple(int(word) for word in words[3:end]),
            latch_cycles=tuple(int(word) for word in words[end + 1 :]),
        )

    def lag_ms(self) -> int:
        """How far emulated time is behind the computer's."""
        return int(self.ask("show").split()[1])


class ProcessorRig(HostBoardRig):
    """Encoder 0 counts up by one from sample to sample, at any phase of them."""

    def turn(self) -> None:
        self.board.do("step 0 500")


async def pressed(
    board: EmulatedProcessor, times: int, rate_hz: float = 500.0
) -> tuple[list[LatchedCounts], list[Press]]:
    """Press the button, with bounces; return what came and what was."""
    rig = ProcessorRig(board, debounce_us=5000)
    presses = []
    with rig.driver:
        taken = await up(rig, rate_hz)
        for n in range(times):
            board.do(f"bounce 0 {1 - n % 2} 5")
            presses.append(board.last_press())
            await taken.until(
                lambda n=n: len(taken.of(LatchedCounts)) == n + 1, "the press"
            )
            rig.driver.acknowledge(taken.of(LatchedCounts)[-1].token)
    return taken.of(LatchedCounts), presses


def assert_the_tester_passes(board: EmulatedProcessor, folder: Path) -> None:
    """Run `traverse board test`, which expects answers and samples in real time.

    A failure while a busy computer's emulator falls behind is tried twice more.
    """
    for _ in range(3):
        lag_ms = board.lag_ms()
        tester = run_traverse(folder, "board", "test", str(board.link), status=None)
        if tester.returncode == 0:
            assert "fail" not in tester.stdout
            return
        assert board.lag_ms() > lag_ms, tester
    pytest.fail("the emulator falls behind the computer's clock: relieve the computer")
