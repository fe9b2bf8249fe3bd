"""AMT21 encoders for tests to command, in their own bytes; nothing of the code here.

They answer through a pty (`PtyEncoders`), or in virtual time.
"""

import contextlib
import os
import select
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.tools.virtual_time import Cable
from traverse.testing.pty_peer import PtyPeer

TURN_S, LOOK_S = 0.02, 0.001


def word(value: int) -> bytes:
    """14 bits with the check bits that make both parities odd."""
    ones = [sum(value >> bit & 1 for bit in range(first, 14, 2)) for first in (1, 0)]
    check = (1 - ones[0] % 2) << 1 | (1 - ones[1] % 2)
    return (value | check << 14).to_bytes(2, "little")


@dataclass
class FakeEncoder:
    """One encoder.

    Attributes:
        count: of the whole shaft, turns included.
        step: added to the count with each requested position.
        silent, garbled: how many of the next requests it does so to.
        late_s: by how much its next answer is late.
        delay_s: from request to reply.
    """

    count: int = 0
    step: int = 0
    silent: float = 0
    garbled: float = 0
    late_s: float = 0.0
    delay_s: float = 0.0002
    speed_counts_s: float = 0.0
    answer: Callable[[bytes], bytes] = bytes

    def reply(self, kind: int, now_s: float) -> tuple[float, bytes]:
        shown = self.count + round(self.speed_counts_s * now_s)
        value = shown % 0x4000 if kind == 0 else (shown >> 14) % 0x4000
        if kind == 0:
            self.count += self.step
        if self.silent > 0:
            self.silent -= 1
            return 0.0, b""
        reply = self.answer(word(value))
        if self.garbled > 0:
            self.garbled -= 1
            reply = bytes((reply[0], reply[1] ^ 0x40))
        delay_s, self.late_s = self.delay_s + self.late_s, 0.0
        return delay_s, reply


class FakeLine:
    """Encoders by their addresses, and an adapter.

    Attributes:
        heard: every byte received from the host.
    """

    def __init__(self, *addresses: int, echo: bool = False) -> None:
        self.encoders = {address: FakeEncoder() for address in addresses}
        self.echo = echo
        self.heard = b""
        self._extended = False

    def answers(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        self.heard += data
        out = []
        for byte in data:
            if self.echo:
                out.append((0.0, bytes((byte,))))
            extended, self._extended = self._extended, byte & 3 == 2
            encoder = self.encoders.get(byte & 0xFC)
            if encoder is not None and not extended and byte & 3 < 2:
                out.append(encoder.reply(byte & 3, now_s))
        return [answer for answer in out if answer[1]]


class VirtualEncoders:
    def __init__(self, line: FakeLine, cable: Cable) -> None:
        self.line, self._cable = line, cable
        self._coming: list[tuple[float, bytes]] = []
        self.strays: list[tuple[float, bytes]] = []

    def live(self, now_s: float) -> None:
        data, self._cable.to_device = self._cable.to_device, b""
        for delay_s, answer in self.line.answers(data, now_s):
            self._coming.append((now_s + delay_s, answer))
        due = [c for c in sorted(self._coming + self.strays) if c[0] <= now_s]
        self._coming = [c for c in self._coming if c[0] > now_s]
        self.strays = [c for c in self.strays if c[0] > now_s]
        self._cable.to_host += b"".join(answer for _, answer in due)

    def next_due_s(self, block_s: float) -> float:
        del block_s
        waiting = [*self._coming, *self.strays]
        return min((at_s for at_s, _ in waiting), default=float("inf"))


class PtyEncoders(PtyPeer):
    """A line behind a symbolic link that keeps its name when plugged again."""

    def __init__(self, line: FakeLine, link: Path) -> None:
        super().__init__(link)
        self.line = line

    def _live(self) -> None:
        while self._plugged:
            if not select.select([self._master], [], [], TURN_S)[0]:
                continue
            try:
                data = os.read(self._master, 4096)
            except OSError:  # no host holds the other end, or may take it any moment
                threading.Event().wait(LOOK_S)
                continue
            for _, answer in self.line.answers(data, 0.0):
                with contextlib.suppress(OSError):
                    os.write(self._master, answer)
