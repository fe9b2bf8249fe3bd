"""A pedal that the kernel holds for real: /dev/uinput makes an input device of ours."""

import asyncio
import fcntl
import os
import struct
from typing import Self

from tests.vm.system import unit

NAME = "Check pedal"
PORT = "/dev/traverse/pedal"
RULE = f'SUBSYSTEM=="input", ATTRS{{name}}=="{NAME}", SYMLINK+="traverse/pedal"\n'
RULES = "/etc/udev/rules.d/71-check.rules"
KEY_B, EV_SYN, EV_KEY, BUS_USB = 48, 0, 1, 3
UI_SET_EVBIT, UI_SET_KEYBIT = 0x4004_5564, 0x4004_5565
UI_DEV_SETUP, UI_DEV_CREATE = 0x405C_5503, 0x5501
SETUP = struct.Struct("=4H80sI")
INPUT_EVENT = struct.Struct("@llHHi")
HELD_S, APART_S = 0.3, 1.5


class Pedal:
    def __init__(self) -> None:
        unit.run("modprobe", "uinput")
        self._fd = os.open("/dev/uinput", os.O_WRONLY | os.O_CLOEXEC)
        self.n_pressed = 0

    def __enter__(self) -> Self:
        fcntl.ioctl(self._fd, UI_SET_EVBIT, EV_KEY)
        fcntl.ioctl(self._fd, UI_SET_KEYBIT, KEY_B)
        setup = SETUP.pack(BUS_USB, 0x1234, 1, 1, NAME.encode(), 0)
        fcntl.ioctl(self._fd, UI_DEV_SETUP, setup)
        fcntl.ioctl(self._fd, UI_DEV_CREATE)
        unit.run("udevadm", "settle", "--timeout=60")
        assert os.path.exists(PORT), f"udev has made no {PORT}"
        return self

    def __exit__(self, *raised: object) -> None:
        os.close(self._fd)

    async def press(self) -> None:
        """Down, up, and some time until the next."""
        self.n_pressed += 1
        for value in (1, 0):
            for kind, code, number in ((EV_KEY, KEY_B, value), (EV_SYN, 0, 0)):
                os.write(self._fd, INPUT_EVENT.pack(0, 0, kind, code, number))
            await asyncio.sleep(HELD_S)
        await asyncio.sleep(APART_S)
