"""Points typed into the program that has the keyboard."""

import asyncio
import threading
import time
from typing import Self

from traverse.client.arm import Arm
from traverse.client.gateways.alarms import alarm_of
from traverse.client.gateways.keyboards import (
    DesktopKeyboard,
    Keyboard,
    UinputKeyboard,
)
from traverse.client.gateways.outlets import NotTakenError, Outlet, Report

SEPARATORS = {"tab": "\t", "enter": "\n", "space": " ", "comma": ",", "semicolon": ";"}
AFTER = {"tab": "\t", "enter": "\n", "space": " "}
KEYBOARDS = {"desktop": DesktopKeyboard, "uinput": UinputKeyboard}
KEY_S = 0.002  # between two keys: programs that take each by itself keep up
STATUS_S = 1.0


def keys_template(separator: str, after: str) -> str:
    """Template of what is typed for a point."""
    columns = SEPARATORS[separator].join(("{x:.4f}", "{y:.4f}", "{z:.4f}"))
    return columns + AFTER[after]


def check_typable(through: str, separator: str) -> None:
    """Refuse a separator that a keyboard has no key for; raises ValueError."""
    if through == "uinput" and separator == "semicolon":
        raise ValueError(
            "--separator semicolon has another key in each layout, which --through "
            "uinput does not know; use tab, space or comma, or --through desktop"
        )


class KeysOutlet(Outlet):
    """Types lines, and never while the arm is in alarm or somebody has stopped it.

    What is not typed at its time is not typed later: the cursor would be elsewhere.

    Args:
        arm: looked at before each point; open while this is.
        through: "desktop" or "uinput".
        stop_key: of `DesktopKeyboard`; stops typing, also within a point, and lets it
            go on when it is pressed again.
        report: called with what happens.
    """

    promise = "typed where the cursor is, and never later; nothing confirms a key"

    def __init__(self, arm: Arm, through: str, stop_key: str, report: Report) -> None:
        super().__init__(report)
        self.name = "the keyboard"
        self._arm = arm
        self._through = through
        self._stop_key = stop_key
        self._stopped = threading.Event()
        self._keyboard: Keyboard | None = None

    async def __aenter__(self) -> Self:
        self._loop = asyncio.get_running_loop()
        self._keyboard = KEYBOARDS[self._through](self._stop_key, self._on_stop)
        self.name = f"{self._keyboard.name} ({self._stop_key} stops it)"
        return self

    def close(self) -> None:
        """Release the keyboard."""
        self._stopped.set()
        if self._keyboard is not None:
            self._keyboard.close()

    async def send(self, data: bytes) -> None:
        """Type; raises NotTakenError, and KeyboardGoneError."""
        if (reason := await self._reason_not_to()) is not None:
            raise NotTakenError(reason)
        # Not tried again as other outlets do: a part may have been typed.
        await self._send(data)

    async def _send(self, data: bytes) -> None:
        if self._keyboard is not None:
            await asyncio.to_thread(self._type, self._keyboard, data.decode())

    def _type(self, keyboard: Keyboard, text: str) -> None:
        for n_typed, character in enumerate(text):
            if self._stopped.is_set():
                left = f"{n_typed} of {len(text)} keys are typed"
                raise NotTakenError(f"stopped by {self._stop_key}; {left}")
            keyboard.tap(character)
            time.sleep(KEY_S)

    async def _reason_not_to(self) -> str | None:
        if self._stopped.is_set():
            return f"typing is stopped; {self._stop_key} lets it go on"
        try:
            async with asyncio.timeout(STATUS_S):
                status = await self._arm.status()
        except TimeoutError:
            return "the arm does not say how it is"
        return alarm_of(status)

    def _on_stop(self) -> None:
        # Before the loop has its turn: the next key must not be typed.
        if self._stopped.is_set():
            self._stopped.clear()
            said = "typing goes on with the next point"
        else:
            self._stopped.set()
            said = f"typing is stopped; {self._stop_key} lets it go on"
        self._loop.call_soon_threadsafe(self._report, said)
