"""Rates and noise of each kind of encoder at the firmware's two boards.

The compiled firmware runs in its emulators, with models of seven encoders, beside
nothing else: the button is pressed and released, with bounces. *Edge to latch* counts
processor cycles from the first contact until the encoders are latched; incremental
ones are latched at the mark. *Point noise* is what the rounding of counts alone makes
of a point: root mean square over random postures of the demonstration's arm. Needs the
compilers and emulators of `make system` and `make node`.
"""

import argparse
import asyncio
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.drivers.bar_devices import ARM
from benchmarks.tools.sizes import sized
from tests.firmware.emulated import (
    COUNTS_PER_TURN,
    ENCODER_KINDS,
    EmulatedProcessor,
    EncoderKind,
    Press,
    ProcessorRig,
)
from tests.firmware.mega import MegaBoard, mega_firmware
from tests.firmware.pico import PicoBoard, pico_firmware
from traverse.drivers.base.values import DeviceUp, LatchedCounts
from traverse.kinematics.arm_file.arm import read_arm
from traverse.simulator.arm.physics import centre_rates
from traverse.simulator.arm.truth import Deviations, true_arm
from traverse.testing.deliveries import Deliveries

INCREMENTAL = EncoderKind("QUADRATURE", "quadrature", 13, ())


@dataclass(frozen=True, slots=True)
class Processor:
    """One of the two boards."""

    name: str
    cycles_per_us: int
    firmware: Callable[..., Path]
    board: Callable[..., EmulatedProcessor]


PROCESSORS = (
    Processor("Mega", 16, mega_firmware, MegaBoard),
    Processor("Pico", 125, pico_firmware, PicoBoard),
)


@dataclass(frozen=True, slots=True)
class Reached:
    """Figures that a board reached with a kind of encoders."""

    cycles: tuple[int, ...]
    max_rate_hz: float


async def reached(
    processor: Processor, kind: EncoderKind, n_changes: int, folder: Path
) -> Reached:
    """Press and release the button of an idle board."""
    firmware = processor.firmware(*f"FRONT_END={kind.settings}".split())
    options = ["--encoders", kind.model, "--bits", str(kind.bits)]
    if kind is INCREMENTAL:
        options += ["--counts-per-turn", str(COUNTS_PER_TURN)]
    presses: list[Press] = []
    with processor.board(folder / "port", firmware, *options) as board:
        rig = ProcessorRig(board, debounce_us=5000)
        board.do("turn 0 0")
        with rig.driver:
            deliveries = Deliveries(rig.delivery_queue)
            await deliveries.until(lambda: deliveries.of(DeviceUp), "the board is up")
            for n in range(n_changes):
                board.do(f"bounce 0 {1 - n % 2} 5")
                presses.append(board.last_press())
                await deliveries.until(
                    lambda: len(deliveries.of(LatchedCounts)) == len(presses), "an edge"
                )
                rig.driver.acknowledge(deliveries.of(LatchedCounts)[-1].token)
            identity = deliveries.of(DeviceUp)[0].identity
    cycles = [
        cycles
        for press in presses
        for cycles in press.latch_cycles or (press.mark_cycles,)
    ]
    return Reached(tuple(cycles), identity.max_rate_hz)


def point_noise_mm(bits: int, n_postures: int = 2000) -> float:
    """Root mean square of a point's error by rounding counts of so many bits."""
    arm = read_arm(ARM)
    mechanism = true_arm(arm, Deviations(), 0).mechanism
    draw = np.random.default_rng(0)
    postures_rad = draw.uniform(-np.pi, np.pi, (n_postures, len(arm.joints)))
    _, rates_mm = centre_rates(mechanism, postures_rad)
    step_rad = 2.0 * np.pi / 2**bits / np.sqrt(12.0)
    return float(step_rad * np.sqrt(np.mean(np.sum(rates_mm**2, axis=(1, 2)))))


def cell(processor: Processor, row: Reached) -> str:
    least, most = min(row.cycles), max(row.cycles)
    cycles = f"{least}" if least == most else f"{least} to {most}"
    latest_us = most / processor.cycles_per_us
    digits = 1 if latest_us < 10.0 else 0
    return f"{cycles} ({latest_us:.{digits}f} µs) | {row.max_rate_hz:.0f} Hz"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.drivers.boards")
    parser.add_argument(
        "--changes", type=int, default=sized(20, 2), help="of the button"
    )
    arguments = parser.parse_args()
    print("| encoders | bits | point noise |", end="")
    print(*(f" {p.name}: edge to latch | largest rate |" for p in PROCESSORS), sep="")
    print("|---" * 7 + "|")
    for kind in (INCREMENTAL, *ENCODER_KINDS):
        print(
            f"| {kind.model} | {kind.bits} | {point_noise_mm(kind.bits):.2g} mm |",
            end="",
        )
        for processor in PROCESSORS:
            with tempfile.TemporaryDirectory() as name:
                row = asyncio.run(
                    reached(processor, kind, arguments.changes, Path(name))
                )
            print(f" {cell(processor, row)} |", end="", flush=True)
        print()


if __name__ == "__main__":
    main()
