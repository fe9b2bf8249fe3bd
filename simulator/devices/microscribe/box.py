"""The box inside a MicroScribe: its responses to each byte of a host.

Written from the published protocol. It waits for "IMMC", echoes it, and after "BEGIN"
reports its identity; from then on a byte below 80 requests a packet and one above is a
command, echoed before its reply. C5 ends the session, and then it follows the baud rate
of the next caller.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

CALL, BEGIN = b"IMMC", b"BEGIN"
GEOMETRY, HOME, GO_HOME, SET_HOME, SET_BAUD, END, MAXES, SET_GEOMETRY = range(
    0xC0, 0xC8
)
PRODUCT, PRODUCT_ID, MODEL, SERIAL, COMMENT, FORMAT, VERSION = range(0xC8, 0xCF)
MOTION, SET_REFERENCE, FACTORY, MARKER, SET_DACS = range(0xCF, 0xD4)
ARGUMENTS = {SET_BAUD: 1, MARKER: 1, SET_DACS: 1}
WITH_PASSWORD = frozenset((SET_HOME, SET_GEOMETRY, SET_REFERENCE, FACTORY))
BAUD_CODES = {12: 9600, 11: 19200, 10: 38400, 3: 14400, 2: 28800, 1: 57600, 0: 115200}
ENCODERS = {2: (0, 2, 3, 6), 3: (0, 2, 4, 8)}
ALL_ENCODERS = 3
GREATEST_TIMER = 16383


@dataclass(frozen=True, slots=True)
class Nameplate:
    """Stored identity of the box.

    Attributes:
        hci: version of the protocol, 2 or 3.
        geometry: block of its own table.
        home: counts at the home position, 6 of them.
        maxes: greatest counts of the encoders that are there.
    """

    hci: int
    texts: dict[int, bytes]
    geometry: bytes
    home: tuple[int, ...]
    maxes: tuple[int, ...]

    @property
    def n_encoders(self) -> int:
        return ENCODERS[self.hci][3]


@dataclass(frozen=True, slots=True)
class Report:
    """A requested report of motion."""

    delay_s: float
    command: int
    buttons: int
    deltas: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class State:
    """Inputs of the box at an instant."""

    buttons: int
    ticks: int
    counts: tuple[int, ...]


class HciBox:
    """A box that has just been switched on.

    Args:
        state_at: latches buttons, timer and encoders at an instant, for a command.
        go_home: puts the encoders at the home position from an instant on.

    Attributes:
        baud_rate: of the session; None while it waits for one.
        report: running report, or None.
        n_rejected: bytes without meaning, or that required a password.
    """

    def __init__(
        self,
        plate: Nameplate,
        state_at: Callable[[float, int], State],
        go_home: Callable[[float], None],
    ) -> None:
        self._plate = plate
        self._answers = {
            **{command: text + b"\0" for command, text in plate.texts.items()},
            GEOMETRY: bytes((len(plate.geometry),)) + plate.geometry,
            HOME: b"".join(home.to_bytes(2, "big") for home in plate.home),
            MAXES: _greatest(plate),
        }
        self._state_at = state_at
        self._go_home = go_home
        self.baud_rate: int | None = None
        self.report: Report | None = None
        self.n_rejected = 0
        self._called = False
        self._coming = b""
        self._command_bytes = 0  # bytes of the command being received

    def receive_byte(self, byte: int, at_s: float, baud_rate: int) -> bytes:
        if self.baud_rate is None:
            return self._wait_for_session(byte, baud_rate)
        if baud_rate != self.baud_rate:
            self.n_rejected += 1  # at another rate it is noise
            return b""
        if self._coming:
            return self._take_argument(byte, at_s)
        if byte < 0x80:
            if byte == 0:
                self.report = None
            return self.packet(byte, self._state_at(at_s, byte))
        return self._begin_command(byte, at_s)

    def packet(self, command: int, state: State) -> bytes:
        packet = bytearray((command | 0x80, state.buttons & 0x7F))
        if command & 0x20:
            packet += _halves(state.ticks)
        if n_analogs := (0, 2, 4, 8)[command >> 2 & 3]:
            packet += bytes(n_analogs + 1)  # nothing is connected there
        for count in self.requested_counts(command, state):
            packet += _halves(count)
        return bytes(packet)

    def requested_counts(self, command: int, state: State) -> Sequence[int]:
        """Return the counts that a command requests, 0 for absent encoders."""
        counts = (*state.counts, *[0] * self._plate.n_encoders)
        return counts[: ENCODERS[self._plate.hci][command & 3]]

    def _wait_for_session(self, byte: int, baud_rate: int) -> bytes:
        self._coming += bytes((byte,))
        if self._coming == CALL:
            self._coming, self._called = b"", True
            return CALL
        if self._called and self._coming == BEGIN:
            self._coming, self._called = b"", False
            self.baud_rate = baud_rate
            return self._plate.texts[PRODUCT_ID] + b"\0"
        if not any(word.startswith(self._coming) for word in (CALL, BEGIN)):
            self.n_rejected += byte != END
            self._coming = bytes((byte,)) if byte in b"IB" else b""
        return b""

    def _begin_command(self, byte: int, at_s: float) -> bytes:
        echo = bytes((byte,))
        if byte == END:
            self.baud_rate = self.report = None
            return b""
        if byte == GO_HOME:
            self._go_home(at_s)
        elif byte in WITH_PASSWORD:
            self._coming = echo  # until a NUL
        elif byte in ARGUMENTS or byte == MOTION:
            most = 12 + 2 * self._plate.n_encoders
            self._coming, self._command_bytes = echo, ARGUMENTS.get(byte, most) + 1
            if byte == MOTION:
                return b""  # it is returned when all of it has arrived
        elif byte not in self._answers:
            self.n_rejected += 1
            return b""
        return echo + self._answers.get(byte, b"")

    def _take_argument(self, byte: int, at_s: float) -> bytes:
        self._coming += bytes((byte,))
        command = self._coming[0]
        if command in WITH_PASSWORD:
            if byte == 0:  # no password is ever right here
                self._coming = b""
                self.n_rejected += 1
            return b""
        if len(self._coming) < self._command_bytes:
            return b""
        arguments, self._coming = self._coming[1:], b""
        if command == MARKER:
            return arguments
        if command == SET_BAUD:
            self.baud_rate = BAUD_CODES.get(arguments[0], self.baud_rate)
        if command != MOTION:
            return b""
        delay_ms = int.from_bytes(arguments[:2], "big")
        steps = arguments[12:]
        self.report = Report(
            max(1, delay_ms) * 1e-3,
            arguments[2],
            arguments[3],
            tuple(
                int.from_bytes(steps[k : k + 2], "big") for k in range(0, len(steps), 2)
            ),
        )
        return bytes((MOTION,))


def _greatest(plate: Nameplate) -> bytes:
    """Encode greatest counts: buttons, timer, analogs, their low bits, encoders."""
    greatest = (*plate.maxes, *[0] * plate.n_encoders)[: plate.n_encoders]
    size = 2 if plate.hci == 2 else 4
    encoders = b"".join(count.to_bytes(size, "big") for count in greatest)
    return b"\x03" + GREATEST_TIMER.to_bytes(2, "big") + bytes(9) + encoders


def _halves(number: int) -> bytes:
    """Encode 14 bits as two bytes without their bit 7."""
    return bytes((number >> 7 & 0x7F, number & 0x7F))
