"""Files of a simulated arm and its daemon in a folder, and programs that use them."""

import json
import signal
import uuid
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import traverse.cli
from tests.end_to_end.programs import Program
from tests.established import believe_utc, identify
from traverse.daemon.pose.arm_model import read_model
from traverse.daemon.references.memory import ConfirmedDevice, encoders_text
from traverse.daemon.references.memory_file import ReferenceFile
from traverse.daemon.state_dir import REFERENCES

DEMO_ARM = Path(traverse.cli.__file__).parent / "demo_data" / "arm.toml"
BOARD_SERIAL = (b"SIM" + bytes(5) + bytes((11, 0, 0, 0))).hex()  # of seed 11
QUICK = (
    "move_s = 0.1\nacceleration_rad_s2 = 300.0\napproach_s = 0.05\n"
    "dwell_s = 0.06\npress_s = 0.03\nswitch_speed_mm_s = 150.0"
)


def rest(duration_s: float) -> str:
    """A motion of the simulator's file: none."""
    return f'[[motion]]\nkind = "rest"\nduration_s = {duration_s}'


REST = rest(1000.0)
SPHERE = (
    '[[motion]]\nkind = "sphere"\nartefact = "ball"\n'
    "centre_mm = [700.0, 100.0, 120.0]\nradius_mm = 50.8\npoints = {points}"
)
CONE = (
    '[[motion]]\nkind = "cone"\nartefact = "seat"\n'
    "seat_mm = [600.0, -150.0, 60.0]\npostures = {postures}"
)
SWEEP = (
    '[[motion]]\nkind = "sweep"\nover = "sphere"\nartefact = "swept"\n'
    "centre_mm = [700.0, 100.0, 120.0]\nradius_mm = 50.8\nspeed_mm_s = 200.0"
)


@dataclass
class Workbench:
    """An arm on a pty and a daemon, as files; `simulator` and `daemon` start them.

    Attributes:
        folder: where everything is.
        host, port: of the broker; port 0 leaves the table out.
        arm: name of the arm, unique so that retained messages do not mix.
    """

    folder: Path
    host: str
    port: int
    arm: str = field(default_factory=lambda: f"arm-{uuid.uuid4().hex[:8]}")

    def __post_init__(self) -> None:
        text = DEMO_ARM.read_text("utf-8").replace('"demo-7"', f'"{self.arm}"')
        self.arm_file.write_text(text, "utf-8")
        # Absolute, as the simulated encoders are; see `confirm_board` for the rest.
        text = text.replace("[joints.encoder]", "[joints.encoder]\nabsolute = true")
        self.arm_file.write_text(text, "utf-8")
        identify(self.arm_file)
        self.confirm_board()

    def confirm_board(self, serial: str = BOARD_SERIAL) -> None:
        model = read_model(self.arm_file, {"base": None})
        base = ConfirmedDevice(encoders_text(model, "base", ()), (serial,))
        state = self.folder / "state"
        state.mkdir(exist_ok=True)
        memory = ReferenceFile(state / REFERENCES)
        memory.add({"base": base})
        memory.close()
        believe_utc(self.folder)

    @property
    def arm_file(self) -> Path:
        return self.folder / "arm.toml"

    @property
    def pty(self) -> Path:
        return self.folder / "board.pty"

    def write_simulator(
        self,
        *motions: str,
        arm: str = "",
        board: str = "",
        faults: str = "",
        top: str = "",
    ) -> None:
        parts = [
            'schema = "traverse/simulator/1"\nseed = 11\nstart = "first_start"',
            f'truth_log = "truth.jsonl"\n{top}',
            f'[arm]\nfile = "arm.toml"\n{arm}',
            f"[operator]\n{QUICK}",
            f'[[device]]\nid = "base"\nport = "board.pty"\n{board}',
            *motions,
            faults,
        ]
        (self.folder / "simulator.toml").write_text("\n".join(parts), "utf-8")

    def write_daemon(
        self,
        *,
        broker: str = "",
        capture: str = "",
        trigger: str = "button",
        scan: str = "",
        quality: str = "",
        read_by: str = "",
        source: str = "base",
        devices: str = "",
    ) -> None:
        """Write the daemon's configuration; arguments are TOML inside its tables.

        Args:
            broker, capture, scan, quality: in tables of their names.
            trigger: of the one input.
            read_by: driver of the device `base` and its keys; else the board's.
            source: device of the input.
            devices: whole tables of further devices.
        """
        read_by = read_by or f'driver = "latch-board"\nport = "{self.pty}"'
        parts = [
            '[arm]\nfile = "arm.toml"',
            f'[[device]]\nid = "base"\n{read_by}',
            f'[broker]\nhost = "{self.host}"\nport = {self.port}\n{broker}'
            if self.port
            else "",
            f"[capture]\n{capture}",
            f'inputs = [{{ source = "{source}/{int(trigger == "switch")}", '
            f'trigger = "{trigger}" }}]',
            f"[scan]\n{scan}" if scan else "",
            f"[quality]\n{quality}" if quality else "",
            "[health]\nperiod_s = 0.2",
            devices,
        ]
        (self.folder / "daemon.toml").write_text("\n".join(parts), "utf-8")

    def change(self, file: str, old: str, new: str) -> None:
        text = (self.folder / file).read_text("utf-8")
        assert old in text
        (self.folder / file).write_text(text.replace(old, new), "utf-8")

    def simulator(self, name: str = "simulator") -> Program:
        return Program(self.folder, name, "simulate", "devices", "simulator.toml")

    async def kill_simulator(self, simulator: Program) -> None:
        """Kill it; its link is removed first, as udev does.

        Where the link leads may be the pty of another test as soon as it has ended.
        """
        self.pty.unlink()
        await simulator.stop(signal.SIGKILL)

    def daemon(self, *options: str, name: str = "daemon") -> Program:
        return Program(self.folder, name, "run", "daemon.toml", *options)

    def truth(self) -> list[dict[str, Any]]:
        """Lines of the simulator's truth log: edges, then at the end a summary."""
        text = (self.folder / "truth.jsonl").read_text("utf-8")
        return [json.loads(line) for line in text.splitlines(keepends=True)]

    def presses(self) -> list[dict[str, Any]]:
        """Edges of the truth log at which an input became active."""
        return [e for e in self.truth() if e["event"] == "edge" and e["level"] == 1]
