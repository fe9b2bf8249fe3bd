"""A line on which frames are lost, corrupted, late, and so on, by faults."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from traverse.simulator.scenario.faults import Fault, LateFault

SPEECHLESS = frozenset({"silent", "reset"})
ON_THE_WIRE = frozenset({"lost", "corrupted", "repeated", "garbage", "cut"})


@dataclass(slots=True)
class FaultCounts:
    """How often the line was disturbed."""

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
    """What is between the board and the port.

    Attributes:
        faults: Of the line, and `silent` ones.
        counts: What was done so far.
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
        """Give the bytes that go out for a frame; none if it is lost.

        Args:
            frame: As it should be.
            script_s: When.
            channel: Whose word it is, None for the whole device's.
        """
        for number, fault in self._lasting(script_s, channel):
            if fault.kind in SPEECHLESS:
                self.counts.silenced += 1
                return b""
            if fault.kind in ON_THE_WIRE and self._draw(number):
                frame = self._strike(fault.kind, frame, self._draws[number])
        return frame

    def delay_s(self, script_s: float, channel: int | None = None) -> float:
        """The delay of an answer."""
        late_s = 0.0
        for number, fault in self._lasting(script_s, channel):
            if isinstance(fault, LateFault) and self._draw(number):
                self.counts.late += 1
                late_s += fault.delay_s
        return late_s

    def spoils_check(self, script_s: float, channel: int | None = None) -> bool:
        """Whether the check bits of an answer are wrong."""
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
            its_channel = getattr(fault, "channel", None)
            if fault.lasts(script_s) and its_channel in {None, channel}:
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
            at = int(draw.integers(len(frame))) if frame else 0
            return frame[:at] + frame[at + 1 :]
        struck = bytearray(frame)
        if struck:
            bit = int(draw.integers(8 * len(struck)))
            struck[bit // 8] ^= 1 << bit % 8
        return bytes(struck)
