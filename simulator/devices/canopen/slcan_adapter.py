r"""A CAN adapter on a serial port with Lawicel's protocol (slcan).

Commands are letters with figures, ended by a carriage return; a carriage return
confirms, a bell (07) refuses. Frames of the bus come as `t`, three figures of
identifier, one of length, the data in hexadecimal. Only 11-bit classic CAN is
simulated.

    S0 .. S8     bit rate 10k 20k 50k 100k 125k 250k 500k 800k 1M; only while closed
    O  L  C      open, listen only, close
    tiiildd..    send a frame; answered "z\r"
    V  N  F      version, serial number, flags
"""

from pathlib import Path

from traverse.simulator.devices.canopen.can_line import CanLine
from traverse.simulator.devices.pty_port import PtyPort
from traverse.simulator.scenario.signals import OutgoingFrame

YES, NO, SENT = b"\r", b"\a", b"z\r"
BUFFER_BYTES = 65_536
LONGEST_COMMAND = 32
IGNORED = b"YMmZWXsQ"  # filters, stamps, timings: taken, without meaning here


class SlcanAdapter(CanLine):
    """The adapter's side of a pty; rejected commands are answered with a bell."""

    def __init__(self, path: Path) -> None:
        super().__init__(str(path))
        self._port = PtyPort(path, BUFFER_BYTES)
        self._pending = bytearray()
        self._open = self._listens = False

    def receive(self) -> list[tuple[int, bytes]]:
        if self._port.host_changed():
            self._open = False
            self._pending.clear()
        self._pending += self._port.read()
        *commands, unended = bytes(self._pending).split(b"\r")
        self._pending[:] = unended[-LONGEST_COMMAND:]
        frames = []
        for command in commands:
            frame = self._obey(command)
            if frame is not None:
                frames.append(frame)
        self._port.flush()
        return frames

    def send(self, can_id: int, data: bytes) -> None:
        if self._open and not self.bus_off:
            text = f"t{can_id:03X}{len(data)}{data.hex().upper()}\r"
            self.n_dropped += self._port.write([OutgoingFrame(True, text.encode())])

    def flush(self) -> None:
        self._port.flush()

    def readers(self) -> list[int]:
        return self._port.readers()

    def writers(self) -> list[int]:
        return self._port.writers()

    def close(self) -> None:
        self._port.close()

    def _obey(self, command: bytes) -> tuple[int, bytes] | None:
        letter = command[:1]
        if not letter:
            return None  # hosts send empty lines to wake an adapter
        if letter == b"t":
            return self._take_frame(command)
        answer = YES
        if letter in b"OL" and not self._open:
            self._open, self._listens = True, letter == b"L"
        elif letter == b"C":
            self._open = False
        elif letter == b"S":
            known = len(command) == 2 and command[1:] in b"012345678"
            answer = YES if known and not self._open else NO
        elif letter == b"V":
            answer = b"V1013\r"
        elif letter == b"N":
            answer = b"NSIM1\r"
        elif letter == b"F":
            answer = b"F80\r" if self.bus_off else b"F00\r"
        elif letter not in IGNORED:
            answer = NO
        self._answer(answer)
        return None

    def _take_frame(self, command: bytes) -> tuple[int, bytes] | None:
        try:
            can_id, n = int(command[1:4], 16), int(command[4:5])
            data = bytes.fromhex(command[5:].decode("ascii"))
        except ValueError:
            n, can_id, data = -1, 0, b""
        good = n == len(data) <= 8 and can_id <= 0x7FF
        if not good or not self._open or self._listens or self.bus_off:
            self._answer(NO)
            return None
        self._answer(SENT)
        return can_id, data

    def _answer(self, text: bytes) -> None:
        self.n_rejected += text == NO
        self._port.write([OutgoingFrame(False, text)])
