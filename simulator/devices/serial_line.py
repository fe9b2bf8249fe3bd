"""One serial line on a pty, with the time that bytes take.

A pty passes bytes on at once. The delays of a real line are simulated by not looking at
the host's bytes before their time and by holding answers back: a byte takes
`bits_per_byte / baud_rate`, an adapter adds its delays either way. Instants are kept as
numbers, so that latches are exact however late the program is woken; an answer is
written within some tens of microseconds of its instant.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from traverse.simulator.devices.pty_port import PtyPort
from traverse.simulator.devices.serial_table import SerialTable
from traverse.simulator.scenario.faults import Fault, LateFault
from traverse.simulator.scenario.signals import OutgoingFrame

SPEECHLESS = frozenset({"silent", "reset"})
ON_THE_WIRE = frozenset({"lost", "corrupted", "repeated", "garbage", "cut"})


@dataclass(slots=True)
class FaultCounts:
    """Counts of disturbances."""

    lost: int = 0
    corrupted: int = 0
    repeated: int = 0
    garbage: int = 0
    cut: int = 0
    silenced: int = 0
    check: int = 0
    late: int = 0


@dataclass(slots=True)
class DisturbedLine:
    """Link between the board and the port.

    Attributes:
        faults: of the line, and `silent` ones.
    """

    faults: tuple[Fault, ...]
    seed: int
    counts: FaultCounts = field(default_factory=FaultCounts)
    _draws: list[np.random.Generator] = field(init=False)

    def __post_init__(self) -> None:
        self._draws = [
            np.random.default_rng([self.seed, number, getattr(fault, "seed", 0)])
            for number, fault in enumerate(self.faults)
        ]

    def disturb(
        self, frame: bytes, script_s: float, channel: int | None = None
    ) -> bytes:
        """Return the bytes that go out for a frame; none if it is lost.

        No channel means the whole device.
        """
        for number, fault in self._lasting(script_s, channel):
            if fault.kind in SPEECHLESS:
                self.counts.silenced += 1
                return b""
            if fault.kind in ON_THE_WIRE and self._draw(number):
                frame = self._strike(fault.kind, frame, self._draws[number])
        return frame

    def delay_s(self, script_s: float, channel: int | None = None) -> float:
        late_s = 0.0
        for number, fault in self._lasting(script_s, channel):
            if isinstance(fault, LateFault) and self._draw(number):
                self.counts.late += 1
                late_s += fault.delay_s
        return late_s

    def spoils_check(self, script_s: float, channel: int | None = None) -> bool:
        struck = [
            self._draw(number)
            for number, fault in self._lasting(script_s, channel)
            if fault.kind == "check"
        ]
        self.counts.check += any(struck)
        return any(struck)

    def _lasting(
        self, script_s: float, channel: int | None
    ) -> Iterator[tuple[int, Fault]]:
        for number, fault in enumerate(self.faults):
            if fault.strikes(script_s, channel):
                yield number, fault

    def _draw(self, number: int) -> bool:
        fault = self.faults[number]
        struck = self._draws[number].random() < getattr(fault, "probability", 1.0)
        return bool(struck)

    def _strike(self, kind: str, frame: bytes, draw: np.random.Generator) -> bytes:
        setattr(self.counts, kind, getattr(self.counts, kind) + 1)
        if kind == "lost":
            return b""
        if kind == "repeated":
            return frame + frame
        if kind == "garbage":
            return draw.bytes(int(draw.integers(1, 65))) + frame
        if kind == "cut":
            position = int(draw.integers(len(frame))) if frame else 0
            return frame[:position] + frame[position + 1 :]
        struck = bytearray(frame)
        if struck:
            bit = int(draw.integers(8 * len(struck)))
            struck[bit // 8] ^= 1 << bit % 8
        return bytes(struck)


BUFFER_BYTES = 65_536


class SerialLine:
    """The device's end of a line; its owner closes the port."""

    def __init__(self, path: Path, table: SerialTable, bits_per_byte: int) -> None:
        self._table = table
        self._byte_s = bits_per_byte / table.baud_rate if table.baud_rate else 0.0
        self.n_dropped = 0
        self.port = PtyPort(path, BUFFER_BYTES)
        self._coming: deque[tuple[float, int]] = deque()
        self._going: deque[tuple[float, bytes]] = deque()
        self._heard_until_s = 0.0
        self._said_until_s = 0.0

    def listen(self, now_s: float) -> bool:
        """Read from the host; True if it opened or closed the line."""
        changed = self.port.host_changed()
        if changed:
            self._coming.clear()
            self._going.clear()
        received = self.port.read()
        start_s = max(self._heard_until_s, now_s + self._table.request_delay_s)
        for number, byte in enumerate(received, start=1):
            at_s = start_s + number * self._byte_s
            self._coming.append((at_s, byte))
            self._heard_until_s = at_s
            if self._table.echo:
                self._going.append((at_s + self._table.reply_delay_s, bytes((byte,))))
        return changed

    def arrived_by(self, now_s: float) -> Iterator[tuple[float, int]]:
        """Yield bytes that have arrived, each with the instant of its last bit."""
        while self._coming and self._coming[0][0] <= now_s:
            yield self._coming.popleft()

    def say(self, data: bytes, at_s: float) -> None:
        """Send bytes, the first of which leaves at an instant or when it can."""
        ends_s = max(at_s, self._said_until_s) + len(data) * self._byte_s
        self._said_until_s = ends_s
        self._going.append((ends_s + self._table.reply_delay_s, data))

    def release(self, now_s: float) -> None:
        """Pass bytes to the host that have arrived at its end."""
        frames = []
        while self._going and self._going[0][0] <= now_s:
            frames.append(OutgoingFrame(True, self._going.popleft()[1]))
        if frames:
            self.n_dropped += self.port.write(frames)
        else:
            self.port.flush()

    def next_due_s(self) -> float:
        """Return when a byte arrives or an answer is to be passed on."""
        return min(
            self._coming[0][0] if self._coming else float("inf"),
            self._going[0][0] if self._going else float("inf"),
        )
