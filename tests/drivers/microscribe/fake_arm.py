"""A MicroScribe at the other end of a pty, for tests to command.

The box is the simulator's, which implements the arm's side of HCI without the code
under test. It follows the baud rate of the host, and receives nothing at another one
until its session ends.
"""

import contextlib
import os
import select
import struct
import termios
import threading
import time
from dataclasses import replace
from pathlib import Path

from traverse.simulator.devices.microscribe import box
from traverse.simulator.devices.microscribe.device import BAUD_RATES
from traverse.testing.pty_peer import PtyPeer

TEXTS = {
    box.PRODUCT: b"MicroScribe 3D",
    box.PRODUCT_ID: b"IBOX",
    box.MODEL: b"3DX",
    box.SERIAL: b"12345",
    box.COMMENT: b"",
    box.FORMAT: b"Format DH0.5",
    box.VERSION: b"HCI 2.0a",
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
        box: that answers; another one after power was off.
        counts: readings of the encoders; the first increases by one per packet.
        n_lost: number of next answers that lose a byte.
        late_s: by how much the next answer is late.
        latched_ns: when packets were, by the first count in them.
        held_back: the end of the next report is, until reports end.
    """

    def __init__(self, link: Path, hci: int = 2, n_joints: int = 6) -> None:
        super().__init__(link)
        maxes = (7999,) * n_joints
        self.plate = box.Nameplate(hci, TEXTS, TABLE, (0,) * 6, maxes)
        self.counts = [100 * (k + 1) for k in range(self.plate.n_encoders)]
        self.held_back = self.mute = self._changed = False
        self._rest = b""
        self.timer_rate_hz = 1000.0
        self.n_lost = self.n_sessions = self._n_packets = self._buttons = 0
        self.late_s = 0.0
        self.latched_ns: dict[int, int] = {}
        self._lock = threading.Condition(threading.RLock())
        self.power_cycle()

    # -- what tests do --------------------------------------------------------

    def power_cycle(self) -> None:
        with self._lock:
            self.box = box.HciBox(self.plate, self._state_at, lambda at_s: None)
            self._boot_s = time.monotonic()

    def rewrite(self, **values: object) -> None:
        self.plate = replace(self.plate, **values)
        self.power_cycle()

    def move(self, *steps: int) -> None:
        with self._lock:
            for number, step in enumerate(steps):
                modulus = self.plate.maxes[number] + 1
                self.counts[number] = (self.counts[number] + step) % modulus
            self._changed = True

    def press(self, number: int, down: bool) -> None:
        with self._lock:
            bit = 1 << number
            self._buttons = self._buttons | bit if down else self._buttons & ~bit
            self._changed = True

    def serve(self, n: int) -> None:
        """Wait until so many more packets were requested."""
        with self._lock:
            end = self._n_packets + n
            assert self._lock.wait_for(lambda: self._n_packets >= end, 5.0)

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
                if self.box.report is not None and self._changed:
                    self._changed = False
                    packet = self._packet(self.box.report.command)
                    if self.held_back:
                        self._rest, self.held_back = packet[-5:], False
                        packet = packet[:-5]
                    self.say(packet)

    def _take(self, data: bytes) -> None:
        baud_rate = BAUD_RATES.get(termios.tcgetattr(self._master)[4], 0)
        for byte in b"" if self.mute else data:
            begun, reporting = self.box.baud_rate, self.box.report
            answer = self.box.receive_byte(byte, time.monotonic(), baud_rate)
            self.n_sessions += begun is None and self.box.baud_rate is not None
            if answer[:1] == bytes([byte | 0x80]) and byte < 0x80:
                answer = self._spoilt(answer)
            if reporting and not self.box.report:
                answer, self._rest = self._rest + answer, b""
            self.say(answer)

    def _spoilt(self, packet: bytes) -> bytes:
        late_s, self.late_s = self.late_s, 0.0  # a test may set it while this sleeps
        time.sleep(late_s)
        if self.n_lost:
            self.n_lost -= 1
            return packet[:-1]
        return packet

    def _packet(self, command: int) -> bytes:
        return self.box.packet(command, self._state_at(time.monotonic(), command))

    def _state_at(self, at_s: float, command: int) -> box.State:
        self._n_packets += 1
        self.latched_ns[self.counts[0]] = round(at_s * 1e9)
        ticks = int((at_s - self._boot_s) * self.timer_rate_hz)
        ticks %= box.GREATEST_TIMER + 1
        state = box.State(self._buttons, ticks, tuple(self.counts))
        if command & box.ALL_ENCODERS:
            self.counts[0] = (self.counts[0] + 1) % (self.plate.maxes[0] + 1)
        return state
