"""`[[device]]` of the simulator's configuration: the kinds, and common keys.

A new kind is one file in this folder and one line here. Kinds are named, not imported,
so that optional packages are imported only where used.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, ClassVar, Self

from pydantic import BeforeValidator, Field, SerializeAsAny

from traverse.simulator.kind_table import KindTable


@dataclass(frozen=True, slots=True)
class Kind:
    """Location of a kind, as "module:Class" with a module of this folder.

    Attributes:
        table: a child of `DeviceTable`: its keys of the configuration.
        device: a `SimulatedDevice`, made from its table and a `Mounting`.
    """

    table: str
    device: str


def class_named(name: str) -> type[Any]:
    """Import "module:Class", a class of a module in this folder."""
    module, _, attribute = name.partition(":")
    named: type[Any] = getattr(
        import_module(f"traverse.simulator.devices.{module}"), attribute
    )
    return named


DEFAULT = "latch-board"
KINDS = {
    "latch-board": Kind(
        "latch_board.device:LatchBoardTable", "latch_board.device:SimulatedLatchBoard"
    ),
    "canopen": Kind("canopen.table:CanOpenTable", "canopen.device:CanOpenBus"),
    "amt21": Kind("amt21:Amt21Table", "amt21:SimulatedAmt21Line"),
    "microscribe": Kind(
        "microscribe.device:MicroscribeTable", "microscribe.device:SimulatedMicroscribe"
    ),
    "text-line": Kind("text_line:TextLineTable", "text_line:SimulatedTextLine"),
    "modbus": Kind("modbus:ModbusTable", "modbus:SimulatedModbusLine"),
    "rls": Kind("rls:RlsTable", "rls:SimulatedRls"),
}


class DeviceTable(KindTable):
    """Keys of every device; each kind adds its own.

    Attributes:
        FAULTS: kinds of `[[fault]]` that this kind of device plays.
        BY_CHANNEL: each encoder is polled by itself, so that a fault of the line may be
            of one channel alone.
        MOST_CHANNELS: greatest number of encoders.
        id: of the device; the arm file's sources are "<id>/<channel>".
        encoder_turns: turns after which the counts wrap.
    """

    FAMILY = "device"
    KINDS = KINDS
    FAULTS: ClassVar[frozenset[str]] = frozenset()
    BY_CHANNEL: ClassVar[bool] = False
    MOST_CHANNELS: ClassVar[int] = 32

    kind: str = DEFAULT
    id: str = Field(min_length=1)
    encoder_turns: int = Field(default=1, ge=1)

    @classmethod
    def class_of(cls, kind: str) -> type[Self]:
        table_class: type[Self] = class_named(cls.KINDS[kind].table)
        return table_class

    def channel_problems(
        self, counts_per_turn: Sequence[int]
    ) -> Iterator[tuple[str, str]]:
        """Report mismatches with the arm file's encoders on this device.

        Yields:
            A key of the table and its fault.
        """
        del counts_per_turn
        yield from ()


AnyDevice = Annotated[
    SerializeAsAny[DeviceTable], BeforeValidator(DeviceTable.from_table)
]
