"""Boards whose processor is emulated, and a driver on their line."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.firmware.host_rig import EmulatedBoard, HostBoardRig
from tests.running import run_traverse
from traverse.drivers.base.values import (
    STATUS_LATE,
    DeviceAlarm,
    DeviceTemperatures,
    LatchedCounts,
    StreamStarted,
)
from traverse.testing.driver_contract import up

COUNTS_PER_TURN = 8192


@dataclass(frozen=True, slots=True)
class Press:
    """A change of an input.

    Attributes:
        contact_cycle: the processor's cycle at it, since power-up.
        mark_cycles: processor cycles from it to the mark of its latch.
        counts: of the encoders at it.
        latch_cycles: cycles to the latch of each encoder that is latched by a line.
    """

    contact_cycle: int
    mark_cycles: int
    counts: tuple[int, ...]
    latch_cycles: tuple[int, ...]


class EmulatedProcessor(EmulatedBoard):
    """A board whose processor is emulated, with models of encoders at its pins."""

    def last_press(self) -> "Press":
        """Last change of an input, by the emulator."""
        words = self.ask("latency").split()
        end = words.index("channels")
        return Press(
            contact_cycle=int(words[1]),
            mark_cycles=int(words[3]),
            counts=tuple(int(word) for word in words[5:end]),
            latch_cycles=tuple(int(word) for word in words[end + 1 :]),
        )

    def lag_ms(self) -> int:
        """How far emulated time is behind the computer's."""
        return int(self.ask("show").split()[1])


class ProcessorRig(HostBoardRig):
    """Encoder 0 counts up by one from sample to sample, at any phase of them."""

    def turn(self) -> None:
        self.board.do("step 0 500")


async def pressed(
    board: EmulatedProcessor, times: int, rate_hz: float = 500.0
) -> tuple[list[LatchedCounts], list[Press]]:
    """Press the button, with bounces; return the received and the true values."""
    rig = ProcessorRig(board, debounce_us=5000)
    presses = []
    with rig.driver:
        deliveries = await up(rig, rate_hz)
        for n in range(times):
            board.do(f"bounce 0 {1 - n % 2} 5")
            presses.append(board.last_press())
            await deliveries.until(
                lambda n=n: len(deliveries.of(LatchedCounts)) == n + 1, "the press"
            )
            rig.driver.acknowledge(deliveries.of(LatchedCounts)[-1].token)
    return deliveries.of(LatchedCounts), presses


@dataclass(frozen=True, slots=True)
class EncoderKind:
    """A kind of encoders at a board.

    Attributes:
        settings: of the firmware.
        model: the name of its model in the emulators.
        bits: of a count.
        alarms: of encoders 1 to 4 when they are absent, without a
            magnet, weak, disturbed; `None` where it cannot know.
    """

    settings: str
    model: str
    bits: int
    alarms: tuple[int | None, ...]

    @property
    def is_read_in_turn(self) -> bool:
        return self.model in ("as5600-multiplexer", "amt21")


ENCODER_KINDS = [
    EncoderKind("SSI GRAY_CODE=0", "ssi", 19, (8, None, None, None)),
    EncoderKind("BISS", "biss", 19, (8, 2, 1, 2)),
    EncoderKind("AS5047", "as5047", 14, (8, 2, None, 2)),
    EncoderKind("AMT22", "amt22", 14, (8, None, None, 2)),
    EncoderKind("AMT21", "amt21", 14, (8, None, None, 2)),
    EncoderKind("AS5600", "as5600", 12, (8, 2, 1, None)),
    EncoderKind("AS5600 I2C_MULTIPLEXER=1", "as5600-multiplexer", 12, (8, 2, 1, None)),
]
each_kind = pytest.mark.parametrize(
    "kind", ENCODER_KINDS, ids=[kind.model for kind in ENCODER_KINDS]
)


async def assert_the_kind_is_read(
    board: EmulatedProcessor, kind: EncoderKind, n_samples: int, late_cycles: int
) -> None:
    """Stream, press the button, then let encoders 1 to 4 fail."""
    counts = tuple(n * (2**kind.bits - 1) // 6 for n in range(7))
    board.do(*(f"count {n} {count}" for n, count in enumerate(counts)))
    rig = ProcessorRig(board, debounce_us=5000)
    board.do("turn 0 0", "count 0 0")
    expected = {(n, code) for n, code in enumerate(kind.alarms, 1) if code}
    with rig.driver:
        deliveries = await up(rig, 250.0 if kind.is_read_in_turn else 500.0)
        await deliveries.until(lambda: deliveries.of(StreamStarted), "the stream")
        board.do("bounce 0 1 3")
        press = board.last_press()
        await deliveries.until(lambda: deliveries.of(LatchedCounts), "the press")
        await deliveries.until(lambda: len(deliveries.seqs()) > n_samples, "samples")
        board.do(*(f"fail {n} {fault}" for n, fault in enumerate((3, 2, 1, 4), 1)))
        await deliveries.until(
            lambda: len(deliveries.of(DeviceAlarm)) >= len(expected), "alarms"
        )
        lag_ms = board.lag_ms()
    (latch,) = deliveries.of(LatchedCounts)
    assert latch.counts == counts
    assert {
        (a.channel, a.code) for a in deliveries.of(DeviceAlarm) if a.raised
    } == expected
    late = [(status & STATUS_LATE) != 0 for status in latch.status]
    assert press.mark_cycles < late_cycles or all(late)
    if kind.is_read_in_turn:
        assert late[1:] == [True] * 6
    else:
        # A Mega marks others, too: those whose first contact it may have missed.
        assert len(set(late)) == 1
        assert len(set(press.latch_cycles)) == 1  # all by one edge of the clock
    received = deliveries.seqs()[:n_samples]
    assert lag_ms > 0 or received == list(range(n_samples)), "samples were lost"


async def assert_thermometers_are_read(
    board: EmulatedProcessor, rate_hz: float
) -> None:
    """Beside a stream; the first of three is taken away, the last was never there."""
    board.do("temperature 0 -1025", "temperature 1 2550", "temperature 2 -32768")
    rig = ProcessorRig(board)
    with rig.driver:
        deliveries = await up(rig, rate_hz)

        def reported() -> set[tuple[float | None, ...]]:
            return {event.values_c[:3] for event in deliveries.of(DeviceTemperatures)}

        await deliveries.until(
            lambda: (-10.25, 25.5, None) in reported(), "temperatures"
        )
        board.do("temperature 0 -32768", "temperature 1 12500")
        await deliveries.until(lambda: (None, 125.0, None) in reported(), "a loss")
        lag_ms = board.lag_ms()
    between = {(-10.25, 125.0, None), (-10.25, 25.5, None), (None, 125.0, None)}
    assert reported() <= {(None, None, None)} | between
    received = deliveries.seqs()
    assert lag_ms > 0 or received == list(range(len(received))), "samples were lost"


def assert_the_tester_passes(board: EmulatedProcessor, folder: Path) -> None:
    """Run `traverse board test`, which expects answers and samples in real time.

    A failure while a busy computer's emulator falls behind is tried twice more.
    """
    for _ in range(3):
        lag_ms = board.lag_ms()
        tester = run_traverse(folder, "board", "test", str(board.link), status=None)
        if tester.returncode == 0:
            assert "fail" not in tester.stdout
            return
        assert board.lag_ms() > lag_ms, tester
    pytest.fail("the emulator falls behind the computer's clock: relieve the computer")
