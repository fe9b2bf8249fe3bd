"""Keyboards that are no devices: of this desktop, and of this computer's kernel.

A keyboard types one character at a time, and calls `on_stop` when the stop key of a
real keyboard is pressed, from whichever thread.
"""

import asyncio
import os
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from evdev import InputDevice

UINPUT = "/dev/uinput"
CLOSE_S = 2.0


class KeyboardGoneError(ValueError):
    """Nothing can be typed any more; its text says why."""


class Keyboard(Protocol):
    """Types characters.

    Attributes:
        name: for people.
    """

    name: str

    def tap(self, character: str) -> None:
        """Press and release the key of a character.

        Raises:
            KeyboardGoneError: the keyboard cannot be used any more.
        """

    def close(self) -> None:
        """Release what is open."""


class DesktopKeyboard:
    """The desktop's own way, by pynput.

    Under X by its extensions XTEST and RECORD; a Wayland desktop lets this type into
    programs of X only.

    Args:
        stop_key: a function key, "f9" say, "pause" or "esc".
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
            raise ValueError(
                f"--through desktop: no desktop can be reached (DISPLAY is "
                f"{os.environ.get('DISPLAY')!r}); run this in the operator's session, "
                "or use --through uinput"
            ) from error

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
        self._controller = Controller()
        self._keys: dict[str, tuple[Any, bool]] = {
            "\t": (keyboard.Key.tab, False),
            "\n": (keyboard.Key.enter, False),
            **{
                one: self._key_of(one, keyboard.KeyCode.from_vk)
                for one in "0123456789 -.,;"
            },
        }
        self._listener = Listener(
            on_press=lambda pressed, *_: on_stop() if pressed == key else None
        )
        self._listener.start()
        self._listener.wait()

    def tap(self, character: str) -> None:
        """Press and release the key of a character."""
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
        """Stop listening for the stop key, and leave the desktop."""
        with suppress(Exception):  # of a desktop that has gone
            self._listener.stop()
            self._listener.join(CLOSE_S)
        del self._controller  # its connection ends with it

    def _key_of(
        self, character: str, from_keysym: Callable[[int], Any]
    ) -> tuple[Any, bool]:
        """The key of a character, and whether it needs Shift."""
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
    """Close connections to X that pynput leaves open where the server has gone."""
    for name in displays:
        if (display := getattr(owner, name, None)) is not None:
            display.display.socket.close()


class UinputKeyboard:
    """A keyboard of the kernel's (uinput), for consoles, X and Wayland alike.

    The kernel takes keys, not characters: those here give the same character in all
    layouts whose digits need no Shift. Must be made in a running event loop.

    Args:
        stop_key: as of `DesktopKeyboard`; looked for on all readable keyboards.
        on_stop: called when it is pressed.
        path: of the kernel's interface.

    Raises:
        ValueError: there is none here, or it may not be used.
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
        """Press and release the key of a character."""
        if not self._real:
            raise KeyboardGoneError("the keyboard with the stop key was pulled out")
        try:
            for value in (1, 0):
                self._device.write(self._write, self._keys[character], value)
                self._device.syn()
        except OSError as error:
            raise KeyboardGoneError(f"{self.name}: {error}") from error

    def close(self) -> None:
        """Take the keyboard away."""
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
