"""Families of devices: how the joints of the arm are read in a world."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.honesty.arm import AXES, ArmSource

N_JOINTS = len(AXES)
LIVING_COUNTS, LED_RAD_S, LEAST_STILL_S = 3, 2e-3, 0.05  # of a joint that is led


@dataclass(frozen=True, slots=True)
class DeviceSpec:
    """One device.

    Attributes:
        id: In arm file and configuration.
        table: Its `[[device]]` in the simulator's configuration.
        section: Its `[[device]]` in the daemon's.
        ports: Its ports; none on a CAN bus.
        n_joints: How many joints it reads, the next ones from the base.
        absolute: The arm file's key where they are.
    """

    id: str
    table: Mapping[str, Any]
    section: Mapping[str, Any]
    ports: tuple[str, ...]
    n_joints: int
    counts_per_turn: int = 1 << 16
    absolute: bool | None = True


@dataclass(frozen=True, slots=True)
class Family:
    """How an arm is read.

    Attributes:
        latches: All joints are latched at one instant.
        has_clock: Some device has a timer of its own.
        can_swap: Two devices, or two lines of one, can change places.
        can_count: Its encoders may be incremental ones.
        quick_rad_s: Of a joint that is seen to stop between two readings.
        moving_s: For how long it has to be so quick before: for three readings.
        scans_hz: Rates of its scans.
        is_checked: A check sum protects its readings; else one off the motion is left
            out until the next.
        has_board: A board, or a node, reads its encoders.
    """

    name: str
    devices: tuple[DeviceSpec, ...]
    button: str
    latches: bool = False
    has_clock: bool = True
    can_swap: bool = False
    can_count: bool = True
    quick_rad_s: float = 0.3
    moving_s: float = 0.03
    scans_hz: tuple[float, ...] = (50.0, 100.0)
    is_checked: bool = True
    has_board: bool = True

    @property
    def n_devices(self) -> int:
        return len(self.devices)

    @property
    def latches_edges(self) -> bool:
        """Whether a board latches the very edge of the button."""
        name = self.button.partition("/")[0]
        return any(
            spec.id == name and spec.section["driver"] == "latch-board"
            for spec in self.devices
        )

    @property
    def still_s(self) -> float:
        """After which time an encoder that froze in motion is seen to have."""
        count_rad = 2.0 * np.pi / self.devices[0].counts_per_turn
        return max(LEAST_STILL_S, LIVING_COUNTS * count_rad / LED_RAD_S)

    def shows(self, kind: str) -> bool:
        """Return whether encoders that freeze so in motion are seen, beside others."""
        return kind != "frozen_device" or self.devices[0].n_joints < N_JOINTS

    def joints(self, device: int) -> slice:
        """Return the joints that a device reads, by its number."""
        first = sum(spec.n_joints for spec in self.devices[:device])
        return slice(first, first + self.devices[device].n_joints)

    def sources(self, *, is_incremental: bool) -> list[ArmSource]:
        return [
            ArmSource(
                f"{device.id}/{channel}",
                device.counts_per_turn,
                1 if (number + channel) % 3 else -1,
                False if is_incremental else device.absolute,
            )
            for number, device in enumerate(self.devices)
            for channel in range(device.n_joints)
        ]


def _board(name: str, n_joints: int, *, button: bool) -> DeviceSpec:
    port = f"/ports/{name}"
    return DeviceSpec(
        name,
        {
            "kind": "latch-board",
            "port": port,
            "inputs": ("button",) if button else (),
        },
        {"driver": "latch-board", "port": port},
        (port,),
        n_joints,
        1 << 22,
    )


def _text(n_joints: int) -> DeviceSpec:
    port, counts = "/ports/text", 1 << 16
    fields = ",".join("{joint}" for _ in range(n_joints))
    return DeviceSpec(
        "text",
        {"kind": "text-line", "port": port, "rate_hz": 100.0, "buttons": ("button",)},
        {
            "driver": "text-line",
            "port": port,
            "pattern": f"$TRV,{{seq}},{{time}},{fields},{{buttons}}*{{checksum}}",
            "checksum": "xor",
            "counts_per_turn": (counts,) * n_joints,
        },
        (port,),
        n_joints,
        counts,
    )


def _amt21() -> DeviceSpec:
    port, addresses = "/ports/amt21", tuple(4 * k for k in range(1, N_JOINTS + 1))
    return DeviceSpec(
        "line",
        {
            "kind": "amt21",
            "port": port,
            "addresses": addresses,
            "baud_rate": 2_000_000,
            "turnaround_s": 5e-6,
        },
        {"driver": "amt21", "port": port, "addresses": addresses},
        (port,),
        N_JOINTS,
        1 << 14,
    )


def _rls() -> DeviceSpec:
    ports = tuple(f"/ports/rls{k}" for k in range(N_JOINTS))
    return DeviceSpec(
        "rls",
        {
            "kind": "rls",
            "ports": ports,
            "bits": 17,
            "baud_rate": 115_200,
        },
        {"driver": "rls", "ports": ports, "bits": 17},
        ports,
        N_JOINTS,
        1 << 17,
    )


def _modbus() -> DeviceSpec:
    port, addresses = "/ports/modbus", tuple(range(1, N_JOINTS + 1))
    counts = 1 << 16
    return DeviceSpec(
        "bus",
        {
            "kind": "modbus",
            "port": port,
            "addresses": addresses,
            "baud_rate": 115_200,
        },
        {
            "driver": "modbus",
            "port": port,
            "baud_rate": 115_200,
            "encoders": tuple(
                {
                    "address": address,
                    "position_register": 0,
                    "counts_per_turn": counts,
                }
                for address in addresses
            ),
        },
        (port,),
        N_JOINTS,
        counts,
    )


def _canopen() -> DeviceSpec:
    nodes = tuple(range(1, N_JOINTS + 1))
    return DeviceSpec(
        "can",
        {"kind": "canopen", "interface": "virtual", "channel": "can0", "nodes": nodes},
        {
            "driver": "canopen",
            "interface": "virtual",
            "channel": "can0",
            "nodes": nodes,
        },
        ("/ports/can0",),
        N_JOINTS,
        1 << 16,
    )


def _microscribe() -> DeviceSpec:
    port = "/ports/scribe"
    return DeviceSpec(
        "scribe",
        {
            "kind": "microscribe",
            "port": port,
            "hci": 2,
            "pedals": ("button",),
            "baud_rate": 115_200,
        },
        {"driver": "microscribe", "port": port},
        (port,),
        N_JOINTS,
        1 << 13,
        None,
    )


def _handle() -> DeviceSpec:
    return _board("handle", 0, button=True)


_MAKERS: tuple[Callable[[], Family], ...] = (
    lambda: Family(
        "latch", (_board("base", N_JOINTS, button=True),), "base/0", latches=True
    ),
    lambda: Family(
        "latch2",
        (_board("base", 3, button=False), _board("wrist", 3, button=True)),
        "wrist/0",
        can_swap=True,
    ),
    lambda: Family(
        "latch+handle", (_board("base", N_JOINTS, button=False), _handle()), "handle/0"
    ),
    lambda: Family("text", (_text(N_JOINTS),), "text/0", latches=True),
    lambda: Family("text+handle", (_text(N_JOINTS), _handle()), "handle/0"),
    lambda: Family(
        "amt21",
        (_amt21(), _handle()),
        "handle/0",
        quick_rad_s=0.5,
        is_checked=False,
        has_board=False,
    ),
    lambda: Family(
        "rls",
        (_rls(), _handle()),
        "handle/0",
        can_swap=True,
        quick_rad_s=0.5,
        is_checked=False,
        has_board=False,
    ),
    lambda: Family(
        "modbus",
        (_modbus(), _handle()),
        "handle/0",
        quick_rad_s=0.5,
        moving_s=0.1,
        scans_hz=(10.0, 20.0),
        has_board=False,
    ),
    lambda: Family("canopen", (_canopen(), _handle()), "handle/0"),
    lambda: Family(
        "microscribe",
        (_microscribe(),),
        "scribe/0",
        latches=True,
        quick_rad_s=0.5,
        is_checked=False,
    ),
)
FAMILIES: dict[str, Family] = {
    family.name: family for make in _MAKERS for family in (make(),)
}
