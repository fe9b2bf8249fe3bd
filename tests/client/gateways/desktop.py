"""A real X server without a screen, and a field of text in it: xterm with cat."""

import contextlib
import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

from Xlib import XK, X
from Xlib.display import Display
from Xlib.error import ConnectionClosedError
from Xlib.ext import xtest

PATIENCE_S = 30.0
SIZE = (480, 200)
XTERM = ("xterm", "-geometry", "80x20+0+0", "-e", "sh", "-c")


class Desktop:
    """An X server with one program that has the keyboard.

    Attributes:
        name: its DISPLAY.
        server: its X server.
        typed: text that the program has received.
    """

    def __init__(self, name: str, path: Path, server: subprocess.Popen[bytes]) -> None:
        self.name = name
        self.server = server
        self._path = path
        self._display = Display(name)

    @property
    def typed(self) -> str:
        # xterm takes the stop key F9, too, as a sequence of characters.
        return self._path.read_text("utf-8").replace("\x1b[20~", "")

    def press(self, key: str) -> None:
        """Press and release a key of the real keyboard, "F9" say."""
        code = self._display.keysym_to_keycode(XK.string_to_keysym(key))
        for kind in (X.KeyPress, X.KeyRelease):
            xtest.fake_input(self._display, kind, code)
        self._display.sync()

    @property
    def has_window(self) -> bool:
        windows = self._display.screen().root.query_tree().children
        return any(
            shown.get_attributes().map_state == X.IsViewable for shown in windows
        )

    def picture(self) -> bytes:
        """Take a picture: rows of pixels, blue, green, red, unused."""
        root = self._display.screen().root
        return root.get_image(0, 0, *SIZE, X.ZPixmap, 0xFFFFFFFF).data

    def close(self) -> None:
        with contextlib.suppress(ConnectionClosedError):
            self._display.close()
        self._display.display.socket.close()


@contextlib.contextmanager
def desktop(folder: Path) -> Iterator[Desktop]:
    path = folder / "typed.txt"
    size = f"{SIZE[0]}x{SIZE[1]}x24"
    reading, writing = os.pipe()
    # The server names a free display when it takes connections.
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writing), "-screen", "0", size],
        pass_fds=[writing],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    with os.fdopen(reading) as number:
        name = f":{number.readline().strip()}"
    field = subprocess.Popen(
        # stty: whatever is typed is there at once, not after a line's end.
        [*XTERM, f"stty -icanon; cat > {path}"],
        env={**os.environ, "DISPLAY": name},
        stderr=subprocess.DEVNULL,
    )
    shown = Desktop(name, path, server)
    try:
        late = time.monotonic() + PATIENCE_S
        while not (path.exists() and shown.has_window):
            assert time.monotonic() < late, "xterm has shown nothing"
            time.sleep(0.02)
        yield shown
    finally:
        shown.close()
        for process in (field, server):
            process.terminate()
            process.wait(PATIENCE_S)
