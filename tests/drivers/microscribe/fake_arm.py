"""A MicroScribe at the other end of a pty, for tests to command.

It implements the arm's side of HCI without the code under test. It follows the baud
rate of the host, and receives nothing at another one until its session ends.
"""

import contextlib
import os
import select
import struct
import termios
import threading
import time
from pathlib import Path

from tests.drivers.pty_peer import PtyPeer

END, MAXES, MOTION = 0xC5, 0xC6, 0xCF
TEXTS = {
    0xC8: b"MicroScribe 3D",
    0xC9: b"IBOX",
    0xCA: b"3DX",
    0xCB: b"12345",
    0xCC: b"",
    0xCD: b"Format DH0.5",
    0xCE: b"HCI 2.0a",
}
TABLE = struct.pack(
    ">18h",
    *(0, 16384, 0, -16384, 16384, -16384),
    *(0, 750, 10250, 750, 0, 0),
    *(8250, 0, 0, 9000, 0, 5750),
)
TURN_S = 0.01


class FakeMicroscribe(PtyPeer):
    """Behind a symbolic link that keeps its name when the arm is plugged again.

    Attributes:
        hci: 2 or 3.
        maxes: greatest counts.
        counts: readings of the encoders; the first increases by one per packet.
        buttons: bits of the pedals.
        n_lost: number of next answers that lose a byte.
        heard: received requests.
    """

    def __init__(self, link: Path, hci: int = 2, n_joints: int = 6) -> None:
        super().__init__(link)
        self.hci = hci
        self.n_encoders = 6 if hci == 2 else 8
        self.maxes = [7999] * n_joints + [0] * (self.n_encoders - n_joints)
        self.counts = [100 * (k + 1) for k in range(self.n_encoders)]
        self.home = [0] * 6
        self.held_back = False  # the end of the next report, until reports end
        self._rest = b""
        self.timer_rate_hz = 1000.0
        self.timer_max = 16383
        self.texts = dict(TEXTS)
        self.table = TABLE
        self.buttons = 0
        self.n_lost = 0
        self.late_s = 0.0
        self.mute = False
        self.heard: list[bytes] = []
        self.session_baud: int | None = None
        self.n_sessions = 0
        self._boot_s = time.monotonic()
        self._called = self._begun = False
        self._pending = b""
        self._report: int | None = None
        self._changed = False
        self._lock = threading.Condition(threading.RLock())

    # -- the cable ------------------------------------------------------------

    def power_cycle(self) -> None:
        with self._lock:
            self.session_baud = None
            self._called = self._begun = False
            self._report = None
            self._boot_s = time.monotonic()

    # -- what tests do --------------------------------------------------------

    def move(self, *steps: int) -> None:
        with self._lock:
            for number, step in enumerate(steps):
                modulus = self.maxes[number] + 1
                self.counts[number] = (self.counts[number] + step) % modulus
            self._changed = True

    def press(self, number: int, down: bool) -> None:
        with self._lock:
            bit = 1 << number
            self.buttons = self.buttons | bit if down else self.buttons & ~bit
            self._changed = True

    def serve(self, n: int) -> None:
        """Wait until so many more packets were requested."""
        with self._lock:
            end = len(self.heard) + n
            assert self._lock.wait_for(lambda: len(self.heard) >= end, 5.0)

    def say(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            os.write(self._master, data)

    # -- its life -------------------------------------------------------------

    def _live(self) -> None:
        while self._plugged:
            select.select([self._master], [], [], TURN_S)
            with self._lock:
                with contextlib.suppress(OSError):
                    self._take(os.read(self._master, 4096))
                self._lock.notify_all()
                if self._report is not None and self._changed:
                    self._changed = False
                    packet = self._packet(self._report)
                    if self.held_back:
                        self._rest, self.held_back = packet[-5:], False
                        packet = packet[:-5]
                    self.say(packet)

    def _baud(self) -> int:
        names = {getattr(termios, f"B{r}"): r for r in (9600, 19200, 38400, 57600)}
        names[termios.B115200] = 115200
        return names.get(termios.tcgetattr(self._master)[4], 0)

    def _take(self, data: bytes) -> None:
        if self.mute:
            return
        if self.session_baud is not None and self._baud() != self.session_baud:
            return  # noise, to it
        self._pending += data
        while self._pending and (used := self._answer(self._pending)):
            self._pending = self._pending[used:]

    def _answer(self, data: bytes) -> int:
        """Carry out the first request of what is there; how many bytes it had."""
        first = data[0]
        if not self._begun:
            return self._sign_on(data)
        if first == END:
            self.session_baud = None
            self._called = self._begun = False
            self._report = None
            return 1
        self.heard.append(data[:1])
        if first == MOTION:
            size = 13 + 2 * self.n_encoders
            if len(data) < size:
                self.heard.pop()
                return 0
            self._report = data[3]
            self.say(bytes([MOTION]))
            return size
        if first < 0x80:
            if first == 0:
                self._report = None
                self.say(self._rest)
                self._rest = b""
            packet = self._packet(first)
            if self.n_lost:
                self.n_lost -= 1
                packet = packet[:-1]
            if self.late_s:
                time.sleep(self.late_s)
                self.late_s = 0.0
            self.say(packet)
        elif first in self.texts:
            self.say(bytes([first]) + self.texts[first] + b"\0")
        elif first == 0xC0:
            self.say(bytes([first, len(self.table)]) + self.table)
        elif first == 0xC1:
            self.say(bytes([first]) + struct.pack(">6H", *self.home))
        elif first == MAXES:
            body = struct.pack(">BH9x", 3, self.timer_max)
            body += struct.pack(f">{self.n_encoders}H", *self.maxes)
            self.say(bytes([first]) + body.ljust(24 if self.hci == 2 else 44, b"\0"))
        return 1

    def _sign_on(self, data: bytes) -> int:
        if self._called and data.startswith(b"BEGIN"):
            self._begun = True
            self.session_baud = self._baud()
            self.n_sessions += 1
            self.say(b"IBOX-2\0")
            return 5
        if data.startswith(b"IMMC"):
            self._called = True
            self.say(b"IMMC")
            return 4
        return 0 if b"IMMC".startswith(data) or b"BEGIN".startswith(data) else 1

    def _packet(self, command: int) -> bytes:
        out = bytearray([command | 0x80, self.buttons])
        if command & 0x20:
            ticks = int((time.monotonic() - self._boot_s) * self.timer_rate_hz)
            out += bytes(divmod(ticks % (self.timer_max + 1), 128))
        if command & 3:
            for count in self.counts:
                out += bytes(divmod(count, 128))
            self.counts[0] = (self.counts[0] + 1) % (self.maxes[0] + 1)
        return bytes(out)
