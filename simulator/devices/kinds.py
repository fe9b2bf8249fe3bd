"""The kinds of devices: `kind` of a `[[device]]` table.

A new kind is one file in this folder and one line here. Names instead of classes, so
that a kind which needs an optional package is imported only on demand.
"""

from dataclasses import dataclass
from importlib import import_module


@dataclass(frozen=True, slots=True)
class Kind:
    """Where a kind is found, as "module:Class".

    Attributes:
        table: A child of `DeviceTable`: its keys of the configuration.
        device: A `SimulatedDevice`, made from its table and a `Mounting`.
    """

    table: str
    device: str


def class_named(name: str) -> type:
    """Import a class by its name, "module:Class"."""
    module, _, found = name.partition(":")
    named: type = getattr(import_module(module), found)
    return named


DEFAULT = "latch-board"
KINDS = {
    "latch-board": Kind(
        "traverse.simulator.devices.latch_board.device:LatchBoardTable",
        "traverse.simulator.devices.latch_board.device:SimulatedLatchBoard",
    ),
    "canopen": Kind(
        "traverse.simulator.devices.canopen.table:CanOpenTable",
        "traverse.simulator.devices.canopen.device:CanOpenBus",
    ),
    "amt21": Kind(
        "traverse.simulator.devices.amt21:Amt21Table",
        "traverse.simulator.devices.amt21:SimulatedAmt21Line",
    ),
    "microscribe": Kind(
        "traverse.simulator.devices.microscribe.device:MicroscribeTable",
        "traverse.simulator.devices.microscribe.device:SimulatedMicroscribe",
    ),
    "modbus": Kind(
        "traverse.simulator.devices.modbus:ModbusTable",
        "traverse.simulator.devices.modbus:SimulatedModbusLine",
    ),
    "rls": Kind(
        "traverse.simulator.devices.rls:RlsTable",
        "traverse.simulator.devices.rls:SimulatedRls",
    ),
}
