"""A simulated board and a driver that share a real pty and a clock of their own.

The driver's thread is the only one that works: when it waits for bytes, the board lives
on to its next sample, edge or heartbeat. So a script of seconds takes a fraction of
one. The kernel hands on a pty's bytes when it finds the time: the clock stands while
any are on their way, so no reading depends on how busy the machine is.
"""

import contextlib
import select
import threading
from collections.abc import Callable
from pathlib import Path

from traverse.daemon.clock import HostClock
from traverse.drivers.base.delivery_queue import BATCH_WINDOW_NS
from traverse.drivers.base.driver import Driver
from traverse.drivers.base.values import Delivery, DeviceLost, DeviceTemperatures
from traverse.drivers.io.serial_port import SerialPort
from traverse.drivers.latch_board.driver import LatchBoardDriver, LatchBoardOptions
from traverse.simulator.config import SimulatorConfig, config_problems
from traverse.simulator.devices.device import DeviceContext
from traverse.simulator.devices.latch_board.device import SimulatedLatchBoard
from traverse.simulator.devices.pty_port import PtyPort
from traverse.simulator.scenario.course import Course
from traverse.simulator.scenario.script import Script
from traverse.simulator.scenario.truth_log import TruthLog
from traverse.simulator.scenario.wiring import ScriptClock
from traverse.simulator.virtual_arm import (
    build_arm,
    build_course,
    build_script,
    build_sources,
)
from traverse.strict_toml.reader import read_strict

FIRST_NS = 10**12
BLOCK_S = 0.05  # samples that the board sends together
LINGER_S = 0.3  # at the end: the last edge is held, reported and acknowledged
BYTES_S = 10.0  # real time in which a pty surely hands on what was written
BUFFER_BYTES = 65_536


class VirtualClock(HostClock):
    """Monotonic time that moves with the board; 0 s of the board is `FIRST_NS`."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.start_utc_s = 0.0
        self.script = ScriptClock()

    def monotonic_ns(self) -> int:
        return FIRST_NS + round(1e9 * self.now_s)

    def utc_offset_ns(self) -> int:
        begun_s = self.script.begin_s or 0.0
        return round(1e9 * (self.start_utc_s - begun_s)) - FIRST_NS


class CountedPort(PtyPort):
    """The board's end, which counts the bytes in each direction."""

    sent = 0
    heard = 0

    def flush(self) -> None:
        waiting = self._n_waiting_bytes
        super().flush()
        self.sent += waiting - self._n_waiting_bytes

    def _received(self) -> bytes:
        data = super()._received()
        self.heard += len(data)
        return data

    def await_bytes(self) -> None:
        select.select([self.descriptor], [], [], BYTES_S)


class VirtualBoard:
    """A board with an arm behind it, as in `traverse simulate`, in virtual time.

    Args:
        folder: holds simulator.toml with one device, start_utc and no faults.

    Attributes:
        over: set once the script has been played to its end.
    """

    def __init__(self, folder: Path) -> None:
        path = folder / "simulator.toml"
        config = read_strict(path, SimulatorConfig, config_problems)
        arm = build_arm(config, folder, str(path))
        self.script: Script = build_script(config, arm, folder, str(path))
        self.course: Course = build_course(config, arm, self.script)
        self.clock = VirtualClock()
        assert config.start_utc is not None
        self.clock.start_utc_s = config.start_utc.timestamp()
        self.over = threading.Event()
        (table,) = config.device
        (source,) = build_sources(config, arm, self.course, folder)
        self._log = TruthLog(folder / "truth.jsonl", self.course, self.clock.script)
        self._device = SimulatedLatchBoard(
            table,
            DeviceContext(
                folder,
                encoders=arm.encoders[0],
                source=source,
                script=self.script,
                clock=self.clock.script,
                faults=(),
                seed=(config.seed, 0),
                notes=self._log,
                climate=config.climate,
            ),
        )
        self.path = self._device.path
        assert self._device.port is not None
        self._device.port.close()
        self.port = self._device.port = CountedPort(self.path, BUFFER_BYTES)

    def close(self) -> None:
        self._device.close()
        self._log.__exit__(None, None, None)

    @property
    def is_begun(self) -> bool:
        return self.clock.script.begin_s is not None

    def live(self, most_s: float) -> None:
        """Advance to the next event, but no longer than so long."""
        begun_s = self.clock.script.begin_s
        if begun_s is not None:
            end_s = begun_s + self.script.duration_s + LINGER_S
            if self.clock.now_s > end_s:
                self.over.set()
        due_s = min(self._device.next_due_s(BLOCK_S), self.clock.now_s + most_s)
        self.clock.now_s = max(self.clock.now_s, due_s)
        self._device.live(self.clock.now_s)


class Straight:
    """Takes deliveries in the driver's own thread, in the place of a queue."""

    dropped_samples = 0
    dropped_others = 0
    batch_window_ns = BATCH_WINDOW_NS
    together = contextlib.nullcontext

    def __init__(self, take: Callable[[Delivery], object]) -> None:
        self._take = take
        self.lost: DeviceLost | None = None

    def put(self, delivery: Delivery, *, wakes: bool = True) -> bool:
        if isinstance(delivery, DeviceLost):
            self.lost = self.lost or delivery
        self._take(delivery)
        return True

    def wake(self) -> None:
        """Do nothing: deliveries are taken as they are put."""


def played(
    board: VirtualBoard,
    monkeypatch,
    rate_hz: float,
    take: Callable[[Driver, Delivery], object],
    patience_s: float = 30.0,
) -> None:
    """Let a driver read the board's whole script and hand on its deliveries.

    The stream, and with it the script, begins when the board reported its temperature.
    """

    class BoardsPort(SerialPort):
        """A real port; waiting for it runs the board."""

        n_read = 0
        n_written = 0

        def wait(self, seconds: float) -> bool:
            if board.port.sent > self.n_read:
                return super().wait(BYTES_S)
            if board.over.is_set():
                return super().wait(0.05)
            if self.n_written > board.port.heard:
                # What was n_written is there at once.
                board.port.await_bytes()
                seconds = 0.0
            board.live(seconds)
            return super().wait(BYTES_S if board.port.sent > self.n_read else 0.0)

        def read(self) -> bytes:
            data = super().read()
            self.n_read += len(data)
            return data

        def write(self, data: bytes) -> None:
            self.n_written += len(data)
            super().write(data)

    monkeypatch.setattr("traverse.drivers.latch_board.driver.SerialPort", BoardsPort)

    def take_and_begin(delivery: Delivery) -> None:
        take(driver, delivery)
        if isinstance(delivery, DeviceTemperatures) and not board.is_begun:
            driver.request_stream(rate_hz)

    straight = Straight(take_and_begin)
    driver: Driver = LatchBoardDriver(
        "base",
        LatchBoardOptions(port=str(board.path), debounce_us=1000),
        straight,
        monotonic_ns=board.clock.monotonic_ns,
    )
    try:
        with driver:
            ended = board.over.wait(patience_s)
    finally:
        board.close()
    assert straight.lost is None, straight.lost
    assert ended, f"the script was not played within {patience_s:g} s"
