"""The firmware of an Arduino Mega in its emulator, and a driver on its line."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.firmware.built import FIRMWARE
from tests.firmware.host_rig import EmulatedBoard, HostBoardRig
from tests.running import run_program
from tests.shared import new_folder, shared

COUNTS_PER_TURN = 8192
CYCLES_PER_TICK = 8


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


@shared
def mega_emulator() -> Path:
    folder = new_folder()
    run_program("make", "-C", FIRMWARE, "emulators", f"BUILD={folder}", "CC=gcc")
    return folder / "mega-emulator"


@shared
def mega_firmware(*settings: str) -> Path:
    """Build it with settings such as `FRONT_END=SSI`."""
    folder = new_folder()
    run_program("make", "-C", FIRMWARE, "mega", f"BUILD={folder}", *settings)
    return folder / "mega.elf"


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


class MegaBoard(EmulatedProcessor):
    """The emulator; commands are those of firmware/emulators/mega/main.c."""

    def __init__(self, link: Path, firmware: Path, *options: str) -> None:
        words = (str(mega_emulator()), "--link", str(link), "--elf", str(firmware))
        super().__init__(link, program=(*words, *options), ready=f"ready {link}")


class MegaRig(HostBoardRig):
    """Encoder 0 counts up by one from sample to sample, at any phase of them."""

    def turn(self) -> None:
        self.board.do("step 0 500")


@contextlib.contextmanager
def mega_at(link: Path, firmware: Path, *options: str) -> Iterator[MegaBoard]:
    board = MegaBoard(link, firmware, *options)
    try:
        yield board
    finally:
        board.close()
