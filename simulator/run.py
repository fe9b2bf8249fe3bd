"""The program: read the configuration, make the devices, run until the end."""

import ctypes
import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Event
from types import FrameType

from traverse.simulator.config import SimulatorConfig, config_problems
from traverse.simulator.devices.device import DeviceContext, make_device
from traverse.simulator.motions import ReplayMotion
from traverse.simulator.pacing import MonotonicClock, live_fast, live_real
from traverse.simulator.scenario.faults import of_device
from traverse.simulator.scenario.truth_log import TruthLog
from traverse.simulator.scenario.wiring import ScriptClock
from traverse.simulator.virtual_arm import (
    build_arm,
    build_course,
    build_script,
    build_sources,
)
from traverse.strict_toml.problems import FileError, Problem
from traverse.strict_toml.reader import read_strict

DONE, REFUSED = 0, 2
PR_SET_TIMERSLACK = 29  # of linux/prctl.h


def run_simulator(config_path: str | Path) -> int:
    """Run until the script ends or a signal arrives; return the exit status.

    0 done, 2 a file was refused.
    """
    try:
        return _run(Path(config_path))
    except FileError as error:
        print(error, file=sys.stderr)  # noqa: T201 - how a command refuses a file
        return REFUSED


def _run(path: Path) -> int:
    config = read_strict(path, SimulatorConfig, config_problems)
    folder = path.parent
    arm = build_arm(config, folder, str(path))
    script = build_script(config, arm, folder, str(path))
    replayed = isinstance(config.motion[0], ReplayMotion)
    course = None if replayed else build_course(config, arm, script)
    sources = build_sources(config, arm, course, folder)
    clock = ScriptClock(0.0 if config.start == "power_up" else None)
    log_path = None if config.truth_log is None else folder / config.truth_log
    fast = config.clock == "fast"
    host_clock = MonotonicClock()
    with ExitStack() as life:
        stopped = life.enter_context(_signals())
        log = life.enter_context(
            TruthLog(
                log_path,
                course,
                clock,
                origin_ns=None if fast else host_clock.origin_ns,
                readings=config.truth_readings,
            )
        )
        devices = []
        for number, table in enumerate(config.device):
            mounting = DeviceContext(
                folder,
                arm.encoders[number],
                sources[number],
                script,
                clock,
                of_device(config.fault, table.id, table.FAULTS),
                (config.seed, number),
                log,
                config.climate,
            )
            try:
                device = make_device(table, mounting)
            except OSError as error:
                key = next((k for k in ("port", "ports") if hasattr(table, k)), "id")
                where = f"device[{number}].{key}"
                raise FileError(path, [Problem(where, str(error))]) from error
            life.callback(device.close)
            devices.append(device)
        for device in devices:
            print(f"ready {device.id} {device.where}", flush=True)  # noqa: T201 - parents wait for this line
        end_s = script.duration_s if config.exit_at_end else None
        _wake_promptly()
        pace = live_fast if fast else live_real
        pace(devices, host_clock, clock, end_s, stopped.is_set)
        log.summary({device.id: device.totals() for device in devices})
    return DONE


def _wake_promptly() -> None:
    """Make the kernel end waits to the microsecond instead of 50 of them.

    A late answer would shift the middle of an exchange, which hosts take as the time of
    reading.
    """
    ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1)


@contextmanager
def _signals() -> Iterator[Event]:
    """Turn SIGTERM and SIGINT into an event while the program runs."""
    stopped = Event()

    def stop(_number: int, _frame: FrameType | None) -> None:
        stopped.set()

    numbers = (signal.SIGTERM, signal.SIGINT)
    before = {number: signal.signal(number, stop) for number in numbers}
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
