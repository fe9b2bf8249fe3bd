from pathlib import Path

from tests.firmware.built import FIRMWARE
from tests.firmware.emulated import EmulatedProcessor
from tests.running import run_program
from tests.shared import new_folder, shared

CYCLES_PER_TICK = 8


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


class MegaBoard(EmulatedProcessor):
    """The emulator; commands as in firmware/emulators/mega/main.c."""

    def __init__(self, link: Path, firmware: Path, *options: str) -> None:
        words = (str(mega_emulator()), "--link", str(link), "--elf", str(firmware))
        super().__init__(link, program=(*words, *options), ready=f"ready {link}")
