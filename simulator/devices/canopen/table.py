"""Keys of CANopen encoders in the simulator's configuration."""

from collections.abc import Iterator, Sequence
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from traverse.plurals import counted
from traverse.simulator.devices.serial_table import SerialTable
from traverse.simulator.devices.table import DeviceTable

NodeNumber = Annotated[int, Field(ge=1, le=127)]


class CanOpenTable(DeviceTable):
    """Encoders on a bus.

    Attributes:
        interface: "slcan" is an adapter on a pty, others are python-can's.
        port: of the adapter's pty.
        channel: of the other interfaces.
        nodes: numbers of the encoders, by channel; default 1, 2, 3, ...
        told_counts_per_turn: reported ones; default the true ones.
    """

    FAULTS: ClassVar[frozenset[str]] = SerialTable.FAULTS - {"corrupted", "garbage"} | {
        "emcy",
        "duplicate",
        "bus_off",
        "unread",
    }
    BY_CHANNEL: ClassVar[bool] = True

    interface: Literal["slcan", "virtual", "udp_multicast", "socketcan"] = "slcan"
    port: str | None = Field(default=None, min_length=1)
    channel: str | None = Field(default=None, min_length=1)
    nodes: tuple[NodeNumber, ...] = ()
    heartbeat_ms: int = Field(default=0, ge=0, le=0xFFFF)
    told_counts_per_turn: tuple[Annotated[int, Field(ge=0)], ...] = ()

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        required = "port" if self.interface == "slcan" else "channel"
        forbidden = "channel" if required == "port" else "port"
        if getattr(self, required) is None or getattr(self, forbidden) is not None:
            raise ValueError(
                f"interface '{self.interface}' needs the key {required}, "
                f"and not {forbidden}"
            )
        return self

    def channel_problems(
        self, counts_per_turn: Sequence[int]
    ) -> Iterator[tuple[str, str]]:
        """Report mismatches with the arm file's encoders."""
        n = len(counts_per_turn)
        if self.nodes and len(self.nodes) != n:
            yield (
                "nodes",
                f"{len(self.nodes)} given, the arm file has {counted(n, 'encoder')}",
            )
        if len(set(self.nodes)) < len(self.nodes):
            yield "nodes", "a number is given twice; use the fault 'duplicate' for that"
        if self.told_counts_per_turn and len(self.told_counts_per_turn) != n:
            n_entries = len(self.told_counts_per_turn)
            yield "told_counts_per_turn", f"{n_entries} given, the arm file has {n}"
