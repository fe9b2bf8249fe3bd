"""The firmware of a Raspberry Pi Pico in its emulator, under node."""

import os
import tty
from pathlib import Path

from tests.firmware.built import CHECKOUT, FIRMWARE
from tests.firmware.emulated import EmulatedProcessor
from tests.running import run_program
from tests.shared import new_folder, shared

EMULATOR = FIRMWARE / "emulators" / "pico" / "emulator.cjs"
PACKAGES = CHECKOUT / "build" / "node" / "node_modules"


@shared
def pico_firmware(*settings: str) -> Path:
    """Build it with settings such as `FRONT_END=SSI`."""
    folder = new_folder()
    run_program("make", "-C", FIRMWARE, "pico", f"BUILD={folder}", *settings)
    return folder / "pico.bin"


class PicoBoard(EmulatedProcessor):
    """The emulator; commands as in firmware/emulators/pico/emulator.cjs."""

    def __init__(self, link: Path, firmware: Path, *options: str) -> None:
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        link.symlink_to(os.ttyname(slave))
        self._slave = slave  # kept open: the line is there before a host opens it
        words = ("node", str(EMULATOR), "--line", str(master))
        try:
            super().__init__(
                link,
                program=(*words, "--image", str(firmware), *options),
                ready="ready",
                pass_fds=(master,),
                env={**os.environ, "NODE_PATH": str(PACKAGES)},
            )
        finally:
            os.close(master)

    def close(self) -> None:
        super().close()
        os.close(self._slave)
