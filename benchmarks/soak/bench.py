"""Files and programs of the crash test."""

import asyncio
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from benchmarks.tools import rig
from benchmarks.tools.network import Network

PAUSE_S = 0.2
CHECKOUT = Path(__file__).parent.parent.parent


class Kept:
    """A program that is kept running.

    Args:
        command: returns the command line of the next life.

    Attributes:
        down_s: pause after a kill.
    """

    def __init__(
        self,
        name: str,
        folder: Path,
        command: Callable[[], list[str]],
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.name = name
        self._folder = folder
        self._command = command
        paths = {"PYTHONPATH": str(CHECKOUT)}
        self._environment = {**os.environ, **paths, **(environment or {})}
        self._process: subprocess.Popen[bytes] | None = None
        self.kills = 0
        self.starts = 0
        self.down_s = PAUSE_S

    @property
    def is_running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    @property
    def pid(self) -> int:
        if self._process is None:
            raise RuntimeError(f"{self.name} was not started")
        return self._process.pid

    def start(self) -> None:
        self.starts += 1
        with (self._folder / f"{self.name}.log").open("ab") as log:
            self._process = subprocess.Popen(
                self._command(),
                cwd=self._folder,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )

    def kill(self, down_s: float) -> None:
        """Kill it as a power cut does; it restarts after `down_s` seconds."""
        if self._process is not None and self.is_running:
            self.down_s = down_s
            self._process.kill()
            self.kills += 1

    async def keep(self) -> None:
        while True:
            self.start()
            while self.is_running:  # noqa: ASYNC110 - no event reports it
                await asyncio.sleep(0.05)
            await asyncio.sleep(self.down_s)
            self.down_s = PAUSE_S

    def stop(self, number: int = signal.SIGTERM) -> None:
        if self._process is None:
            return
        self._process.send_signal(number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(10)
        self._process.kill()
        self._process.wait()


ARM = "demo-7"

SIMULATION = """\
schema = "traverse/simulator/1"
seed = {seed}
repeat = true
truth_log = "truth-{life}.jsonl"
[arm]
file = "arm.toml"
noise_rad = 3e-6
[operator]
move_s = 0.25
approach_s = 0.05
dwell_s = 0.08
press_s = 0.04
[[device]]
id = "base"
port = "board.pty"
[[motion]]
kind = "cone"
seat_mm = [600.0, -150.0, 60.0]
postures = 12
"""

DAEMON = """\
[arm]
file = "arm.toml"
[[device]]
id = "base"
driver = "latch-board"
port = "{folder}/line.pty"
[broker]
host = "127.0.0.1"
port = {port}
keepalive_s = 5
[capture]
inputs = [{{ source = "base/0", trigger = "button" }}]
[health]
period_s = 1.0
[recording]
flight_mb = 8
min_free_mb = 20
"""

BROKER = """\
listener {port} 127.0.0.1
allow_anonymous true
set_tcp_nodelay true
persistence true
persistence_location {folder}/
user root
"""

# As the unit of systemd starts it.
DAEMON_COMMAND = ("traverse", "run", "--keep-trying", "daemon.toml")


class Bench:
    """An arm, its daemon, a broker, networks, an operator, a consumer.

    Args:
        rate_hz: of the points that the operator commands.

    Attributes:
        lives: names of the lives of the board so far.
        witness_store: file of the consumer of foreign make.
    """

    def __init__(self, folder: Path, state: Path, rate_hz: float) -> None:
        self.folder = folder
        self.state = state
        self.port = rig.free_port()
        self.daemons_network = Network(self.port)
        self.consumers_network = Network(self.port)
        self.lives: list[str] = []
        self.witness_store = folder / "witness.db"
        self.is_quiet = False
        shutil.copy(rig.ARM, folder / "arm.toml")
        (folder / "mosquitto.conf").write_text(
            BROKER.format(port=self.port, folder=folder)
        )
        path = os.pathsep.join((os.environ["PATH"], "/usr/sbin"))
        mosquitto = shutil.which("mosquitto", path=path)
        if mosquitto is None:
            raise FileNotFoundError("mosquitto is not installed; try `make system`")
        self._run = (sys.executable, "-m")
        self.broker = Kept(
            "broker", folder, lambda: [mosquitto, "-c", str(folder / "mosquitto.conf")]
        )
        self.board = Kept("board", folder, self._board_command)
        self.daemon = Kept(
            "daemon",
            folder,
            lambda: [*self._run, *DAEMON_COMMAND],
            {"STATE_DIRECTORY": str(state), "OPENBLAS_NUM_THREADS": "1"},
        )
        self.tap = Kept("tap", folder, self._tap_command)
        self.operator = Kept(
            "operator",
            folder,
            lambda: [
                *(*self._run, "benchmarks.soak.operator", ARM),
                *(f"127.0.0.1:{self.port}", str(rate_hz), "operator.jsonl"),
            ],
        )
        self.consumer = Kept("consumer", folder, self._consumer_command)
        self.witness = Kept("witness", folder, self._witness_command)

    def programs(self) -> Iterator[Kept]:
        yield from (self.broker, self.board, self.tap, self.daemon)
        yield from (self.consumer, self.witness, self.operator)

    def note_disk(self, *, is_sound: bool) -> None:
        """Note among the acknowledgements whether points can be stored."""
        with (self.folder / "acknowledged.jsonl").open("a", encoding="utf-8") as log:
            line = {"time_s": round(time.time(), 3), "disk": is_sound}
            log.write(json.dumps(line) + "\n")

    def write_daemon(self) -> None:
        (self.folder / "daemon.toml").write_text(
            DAEMON.format(folder=self.folder, port=self.daemons_network.port)
        )

    def _board_command(self) -> list[str]:
        life = f"{len(self.lives)}"
        self.lives.append(life)
        (self.folder / "board.pty").unlink(missing_ok=True)
        (self.folder / "life").write_text(life, "ascii")
        text = SIMULATION.format(seed=len(self.lives), life=life)
        (self.folder / "simulator.toml").write_text(text)
        return [*self._run, "traverse", "simulate", "devices", "simulator.toml"]

    def _tap_command(self) -> list[str]:
        files = ("board.pty", "line.pty", "acknowledged.jsonl")
        paths = [str(self.folder / file) for file in files]
        return [*self._run, "benchmarks.soak.tap", *paths]

    def _consumer_command(self) -> list[str]:
        where = f"127.0.0.1:{self.consumers_network.port}"
        store = str(self.folder / "store.db")
        return [*self._run, "benchmarks.soak.consumer", ARM, where, store]

    def _witness_command(self) -> list[str]:
        where = ("127.0.0.1", str(self.consumers_network.port), str(self.witness_store))
        quiet = ["quiet"] if self.is_quiet else []
        return [*self._run, "benchmarks.soak.witness", ARM, *where, *quiet]
