"""The whole chain as programs of their own: mosquitto, simulated board, daemon."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from traverse.kinematics.arm_file.arm import Arm, write_arm

ARM = Path(__file__).parent.parent.parent / "cli" / "demo_data" / "arm.toml"
READY_S = 60.0  # on a busy machine

SIMULATION = """\
schema = "traverse/simulator/1"
seed = 3
repeat = true
{top}
[arm]
file = "arm.toml"
{arm}
[[device]]
id = "base"
port = "board.pty"
{device}
[[motion]]
kind = "sweep"
over = "sphere"
centre_mm = [700.0, 0.0, 100.0]
radius_mm = 60.0
{faults}
"""

DAEMON = """\
[arm]
file = "arm.toml"
[[device]]
id = "base"
driver = "latch-board"
port = "{folder}/board.pty"
debounce_us = 0
[broker]
host = "127.0.0.1"
port = {port}
[capture]
inputs = [{{ source = "base/0", trigger = "button" }}]
[health]
period_s = 1.0
"""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for(
    condition: Callable[[], bool], awaited: str, seconds: float = READY_S
) -> None:
    """Wait until the condition holds; raises TimeoutError."""
    until = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until:
            raise TimeoutError(f"{awaited} not within {seconds:g} s")
        time.sleep(0.02)


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@contextlib.contextmanager
def program(log: Path, *arguments: str) -> Iterator["subprocess.Popen[bytes]"]:
    with log.open("ab") as output:
        process = subprocess.Popen(
            arguments, stdin=subprocess.DEVNULL, stdout=output, stderr=output
        )
    try:
        yield process
    finally:
        stop(process)


def stop(process: "subprocess.Popen[bytes]", number: int = signal.SIGTERM) -> None:
    if process.poll() is None:
        process.send_signal(number)
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextlib.contextmanager
def mosquitto(folder: Path, port: int) -> Iterator["subprocess.Popen[bytes]"]:
    """A real broker, as deploy/ configures it for latency."""
    path = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")
    if path is None:
        raise FileNotFoundError("mosquitto is not installed; try `make system`")
    config = folder / "mosquitto.conf"
    config.write_text(
        f"listener {port} 127.0.0.1\nallow_anonymous true\nset_tcp_nodelay true\n"
        "max_queued_messages 100000\n"
    )
    with program(folder / "mosquitto.log", path, "-c", str(config)) as process:
        wait_for(lambda: listens(port), "mosquitto listening")
        yield process


@contextlib.contextmanager
def simulator(
    folder: Path, device: str = "", faults: str = "", arm: str = "", top: str = ""
) -> Iterator["subprocess.Popen[bytes]"]:
    """The simulated board on ``folder``/board.pty."""
    shutil.copy(ARM, folder / "arm.toml")
    config = folder / "simulator.toml"
    text = SIMULATION.format(top=top, arm=arm, device=device, faults=faults)
    config.write_text(text)
    run = (sys.executable, "-m", "traverse", "simulate", "devices", str(config))
    with program(folder / "simulator.log", *run) as process:
        wait_for((folder / "board.pty").exists, "the simulated board")
        yield process


@contextlib.contextmanager
def daemon(
    folder: Path,
    port: int,
    settings: str = "",
    run: tuple[str, ...] = ("traverse",),
    arm: Arm | None = None,
) -> Iterator["subprocess.Popen[bytes]"]:
    """The daemon on that board and a broker.

    Args:
        folder: of the board, for all files.
        port: of the broker.
        settings: tables of its configuration.
        run: module, and its arguments before the daemon's.
        arm: replaces the board's.
    """
    if arm is None:
        shutil.copy(ARM, folder / "arm.toml")
    else:
        write_arm(folder / "arm.toml", arm)
    config = folder / "daemon.toml"
    config.write_text(DAEMON.format(folder=folder, port=port) + settings)
    log = folder / "daemon.log"
    log.unlink(missing_ok=True)
    command = (sys.executable, "-m", *run, "run", str(config))
    with program(log, *command) as process:
        wait_for(lambda: b"arm demo-7" in log.read_bytes(), "the daemon measuring")
        yield process


def cpu_s(process: "subprocess.Popen[bytes]") -> float:
    fields = Path(f"/proc/{process.pid}/stat").read_text("ascii").rsplit(")", 1)[1]
    user, system = fields.split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def own_mb(process: "subprocess.Popen[bytes]") -> float:
    """Resident memory but for files, which other programs share."""
    text = Path(f"/proc/{process.pid}/status").read_text("ascii")
    line = next(entry for entry in text.splitlines() if entry.startswith("RssAnon:"))
    return int(line.split()[1]) * 1024 / 1e6


def rss_mb(process: "subprocess.Popen[bytes]") -> float:
    pages = int(Path(f"/proc/{process.pid}/statm").read_text("ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
