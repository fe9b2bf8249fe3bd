"""Points typed into the program with the keyboard focus.

Two virtual keyboards: of the desktop, and of the kernel. A keyboard types one character
at a time, and calls `on_stop`, from any thread, when the stop key of a real keyboard is
pressed.
"""

import asyncio
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Protocol, Self

from traverse.client.arm import Arm
from traverse.client.gateways.alarms import alarm_of
from traverse.client.gateways.outlets import NotTakenError, Outlet, Report

if TYPE_CHECKING:
    from evdev import InputDevice

UINPUT = "/dev/uinput"
CLOSE_S = 2.0


class KeyboardGoneError(ValueError):
    """Nothing can be typed any more; states why."""


class Keyboard(Protocol):
    """Types characters."""

    name: str

    def tap(self, character: str) -> None:
        """Press and release the key of a character.

        Raises:
            KeyboardGoneError: the keyboard cannot be used any more.
        """

    def close(self) -> None:
        """Close it."""


def _no_desktop() -> ValueError:
    return ValueError(
        f"--through desktop: no desktop can be reached (DISPLAY is "
        f"{os.environ.get('DISPLAY')!r}); run this in the operator's session, "
        "or use --through uinput"
    )


class DesktopKeyboard:
    """The desktop's keyboard, by pynput.

    Under X by its extensions XTEST and RECORD; a Wayland desktop lets this type into
    programs of X only.

    Args:
        stop_key: a function key, such as "f9", "pause" or "esc".
        on_stop: called when it is pressed.

    Raises:
        ValueError: there is no desktop here, or it has no key for a character.
    """

    def __init__(self, stop_key: str, on_stop: Callable[[], None]) -> None:
        try:
            from pynput import keyboard  # noqa: PLC0415 - of an extra
        except ModuleNotFoundError:
            raise
        except ImportError as error:
            raise _no_desktop() from error

        class Listener(keyboard.Listener):  # type: ignore[misc] # it has no types
            def run(self) -> None:
                # `tap` says that it has ended.
                with suppress(Exception):
                    super().run()
                _close_sockets(self, "_display_stop", "_display_record")

        class Controller(keyboard.Controller):  # type: ignore[misc]
            def __del__(self) -> None:
                with suppress(Exception):  # under X it closes its connection
                    super().__del__()
                _close_sockets(self, "_display")

        key = keyboard.Key[stop_key]
        self.name = "the desktop's keyboard"
        self._shift = keyboard.Key.shift
        try:
            self._controller = Controller()
        except Exception as error:  # each desktop has its own
            raise _no_desktop() from error
        self._keys: dict[str, tuple[Any, bool]] = {
            "\t": (keyboard.Key.tab, False),
            "\n": (keyboard.Key.enter, False),
            **{
                character: self._key_of(character, keyboard.KeyCode.from_vk)
                for character in "0123456789 -.,;"
            },
        }
        self._listener = Listener(
            on_press=lambda pressed, *_: on_stop() if pressed == key else None
        )
        self._listener.start()
        self._listener.wait()

    def tap(self, character: str) -> None:
        if not self._listener.is_alive():
            raise KeyboardGoneError("the desktop has gone, and its stop key with it")
        key, needs_shift = self._keys[character]
        shift = (self._shift,) if needs_shift else ()
        try:
            with self._controller.pressed(*shift):
                self._controller.tap(key)
        except Exception as error:  # each desktop has its own
            raise KeyboardGoneError(f"the desktop takes no keys: {error!r}") from error

    def close(self) -> None:
        with suppress(Exception):  # of a desktop that has gone
            self._listener.stop()
            self._listener.join(CLOSE_S)
        del self._controller  # its connection ends with it

    def _key_of(
        self, character: str, from_keysym: Callable[[int], Any]
    ) -> tuple[Any, bool]:
        mapping = getattr(self._controller, "keyboard_mapping", None)
        if mapping is None:  # only that of X has one
            return character, False
        # As a character pynput would send an event that many programs ignore, xterm
        # say; as a keysym (that of ASCII is its number) it uses XTEST.
        _, shift = mapping.get(ord(character), (0, None))
        if shift not in (0, 1):
            raise ValueError(
                f"--through desktop: this layout has no key for {character!r}; choose "
                "another layout of the keyboard"
            )
        return from_keysym(ord(character)), shift == 1


def _close_sockets(owner: object, *displays: str) -> None:
    """Close connections to X that pynput leaves open when the server has gone."""
    for name in displays:
        if (display := getattr(owner, name, None)) is not None:
            display.display.socket.close()


class UinputKeyboard:
    """A keyboard of the kernel (uinput), for consoles, X and Wayland alike.

    The kernel takes keys, not characters: these give the same character in all layouts
    whose digits need no Shift. Create it in a running event loop.

    Args:
        stop_key: as of `DesktopKeyboard`; read from all readable keyboards.
        on_stop: called when it is pressed.

    Raises:
        ValueError: there is no such device here, or it may not be used.
    """

    def __init__(
        self, stop_key: str, on_stop: Callable[[], None], path: str = UINPUT
    ) -> None:
        _check_uinput(path)
        from evdev import InputDevice, UInput, UInputError, ecodes  # noqa: PLC0415 - of an extra
        from evdev.util import list_devices  # noqa: PLC0415

        codes = ecodes.ecodes
        self.name = "a keyboard of the kernel's"
        self._write = ecodes.EV_KEY
        self._keys = {
            **{digit: codes[f"KEY_{digit}"] for digit in "0123456789"},
            **{"\t": codes["KEY_TAB"], "\n": codes["KEY_ENTER"]},
            **{" ": codes["KEY_SPACE"], "-": codes["KEY_KPMINUS"]},
            **{".": codes["KEY_DOT"], ",": codes["KEY_COMMA"]},
        }
        stop = codes[f"KEY_{stop_key.upper()}"]
        self._loop = asyncio.get_running_loop()
        self._real: list[InputDevice[str]] = []
        for name in list_devices():
            device = InputDevice(name)
            if stop in device.capabilities().get(ecodes.EV_KEY, ()):
                self._real.append(device)
                self._loop.add_reader(device.fd, self._look, device, stop, on_stop)
            else:
                device.close()
        if not self._real:
            raise ValueError(
                f"--through uinput: no keyboard with the stop key {stop_key} can be "
                "read below /dev/input; let this user read them (sudo usermod -aG "
                "input USER, and log in again), or name another --stop-key"
            )
        try:
            self._device = UInput(
                {ecodes.EV_KEY: sorted(set(self._keys.values()))}, "Traverse"
            )
        except (OSError, UInputError) as error:
            self._close_real()
            raise ValueError(f"--through uinput: {path}: {error}") from error

    def tap(self, character: str) -> None:
        if not self._real:
            raise KeyboardGoneError("the keyboard with the stop key was pulled out")
        try:
            for value in (1, 0):
                self._device.write(self._write, self._keys[character], value)
                self._device.syn()
        except OSError as error:
            raise KeyboardGoneError(f"{self.name}: {error}") from error

    def close(self) -> None:
        self._close_real()
        self._device.close()

    def _close_real(self) -> None:
        while self._real:
            device = self._real.pop()
            self._loop.remove_reader(device.fd)
            device.close()

    def _look(
        self, device: "InputDevice[str]", stop: int, on_stop: Callable[[], None]
    ) -> None:
        try:
            for event in device.read():
                if (event.type, event.code, event.value) == (self._write, stop, 1):
                    on_stop()
        except BlockingIOError:
            return
        except OSError:  # it was pulled out
            self._loop.remove_reader(device.fd)
            self._real.remove(device)


def _check_uinput(path: str) -> None:
    if not os.path.exists(path):
        raise ValueError(
            f"--through uinput: {path} does not exist: this kernel has no uinput, or "
            "its module is not loaded; try sudo modprobe uinput, or use --through "
            "desktop in the operator's session"
        )
    if not os.access(path, os.W_OK):
        raise ValueError(
            f"--through uinput: this user may not write {path}; add a udev rule "
            'KERNEL=="uinput", GROUP="input", MODE="0660" and the user to the group '
            "input, or use --through desktop"
        )


SEPARATORS = {"tab": "\t", "enter": "\n", "space": " ", "comma": ",", "semicolon": ";"}
AFTER = {"tab": "\t", "enter": "\n", "space": " "}
KEYBOARDS = {"desktop": DesktopKeyboard, "uinput": UinputKeyboard}
KEY_S = 0.002  # between two keys: programs that take each by itself keep up
STATUS_S = 1.0


def keys_template(separator: str, after: str) -> str:
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
    """Types lines, but never while the arm is in alarm or typing is stopped.

    Skipped lines are not typed later: the cursor would be elsewhere.

    Args:
        arm: checked before each point; open while this is.
        through: "desktop" or "uinput".
        stop_key: of `DesktopKeyboard`; stops typing, also within a point, and
            resumes it when pressed again.
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
            notice = "typing goes on with the next point"
        else:
            self._stopped.set()
            notice = f"typing is stopped; {self._stop_key} lets it go on"
        self._loop.call_soon_threadsafe(self._report, notice)
