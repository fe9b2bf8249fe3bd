"""One arm, once for each driver: encoders of that make on it, and how they are read."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from traverse.drivers.base.driver import Driver
from traverse.drivers.base.registry import driver_class
from traverse.drivers.polling.polled_driver import PolledDriver

ARM = Path(__file__).parent.parent.parent / "cli" / "demo_data" / "arm.toml"
N_JOINTS = 7
ADAPTER = {"request_delay_s": 0.00015, "reply_delay_s": 0.00035}
NODES = tuple(range(1, N_JOINTS + 1))
ADDRESSES = tuple(range(0x54, 0x54 + 4 * N_JOINTS, 4))
PORTS = tuple(f"rls-{number}" for number in range(N_JOINTS))
DeliveryQueue = Any


@dataclass(frozen=True, slots=True)
class Make:
    """Encoders of one make.

    Attributes:
        name: of the driver; it is the device's id too.
        bits: of a turn.
        line: in words.
        table: of the simulated device, besides kind and id.
        options: of the driver; ports are relative to a folder.
        asked_hz: fastest stream that is asked for.
        latches: all encoders at one instant of its own, so that real time does as
            well as virtual time.
    """

    name: str
    bits: int
    line: str
    table: Mapping[str, Any]
    options: Mapping[str, Any]
    asked_hz: float = 1000.0
    latches: bool = False

    @property
    def is_polled(self) -> bool:
        """Its encoders are asked one after the other."""
        return issubclass(driver_class(self.name), PolledDriver)

    def arm_text(self) -> str:
        """The arm file with these encoders on it."""
        text = ARM.read_text("utf-8")
        for counts in ("8388608", "4194304"):
            text = text.replace(counts, str(1 << self.bits))
        return text.replace('"base/', f'"{self.name}/')

    @property
    def is_on_a_bus(self) -> bool:
        """It has no port; its bus is in the memory of one process."""
        return "channel" in self.table

    @property
    def lines(self) -> tuple[str, ...]:
        """Ports of its serial lines."""
        ports: tuple[str, ...] = self.table.get("ports", (self.table.get("port"),))
        return ports

    def driver(
        self, delivery_queue: DeliveryQueue, folder: Path, **more: object
    ) -> Driver:
        """A driver that reads them; more of what it is made with may be given."""
        options = dict(self.options)
        if "port" in options:
            options["port"] = str(folder / options["port"])
        if "ports" in options:
            options["ports"] = tuple(str(folder / port) for port in options["ports"])
        make: Callable[..., Driver] = driver_class(self.name)
        valid = driver_class(self.name).options_class(**options)
        return make(self.name, valid, delivery_queue, **more)


MAKES = (
    Make(
        "latch-board",
        23,
        "USB-CDC",
        {"port": "board", "encoder_turns": 1},
        {"port": "board"},
        latches=True,
    ),
    Make(
        "canopen",
        18,
        "CAN in memory",
        {"interface": "virtual", "channel": "bar", "nodes": NODES},
        {"interface": "virtual", "channel": "bar", "nodes": NODES},
        latches=True,
        asked_hz=25.0,  # enough for an arm at rest, however busy the computer is
    ),
    Make(
        "amt21",
        14,
        "RS-485 2 Mbit/s, USB 0.5 ms",
        {"port": "amt21", "addresses": ADDRESSES, "baud_rate": 2_000_000, **ADAPTER},
        {"port": "amt21", "addresses": ADDRESSES},
    ),
    Make(
        "rls",
        18,
        "7 x 115200 bit/s, USB 0.5 ms",
        {"ports": PORTS, "bits": 18, "baud_rate": 115_200, **ADAPTER},
        {"ports": PORTS, "bits": 18},
    ),
    Make(
        "modbus",
        16,
        "RS-485 115200 bit/s, USB 0.5 ms",
        {
            "port": "modbus",
            "addresses": NODES,
            "baud_rate": 115_200,
            "parity": "none",
            **ADAPTER,
        },
        {
            "port": "modbus",
            "encoders": tuple({"address": n, "counts_per_turn": 65536} for n in NODES),
            "baud_rate": 115_200,
            "parity": "none",
        },
    ),
    Make(
        "microscribe",
        14,
        "115200 bit/s, USB 0.5 ms",
        {
            "port": "microscribe",
            "hci": 3,
            "pedals": ("button",),
            "home": (0,) * 6,
            "geometry": {"alpha": (0,) * 6, "a": (0,) * 6, "d": (0,) * 6},
            "baud_rate": 115_200,
            **ADAPTER,
        },
        {"port": "microscribe"},
    ),
)
BY_NAME = {make.name: make for make in MAKES}
