"""Options of the table of CANopen encoders."""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from traverse.drivers.base.driver import DriverOptions
from traverse.protocol.canopen.frames import FIRST_NODE, LAST_NODE

NodeId = Annotated[int, Field(ge=FIRST_NODE, le=LAST_NODE)]
SyncSource = Literal["auto", "kernel", "host", "external"]
CodeSequence = Literal["keep", "cw", "ccw"]


class CanOpenOptions(DriverOptions):
    """Options of the driver `canopen`; channel i of the device is ``nodes[i]``."""

    interface: str = Field(default="socketcan", pattern=r"^[a-z0-9_]+$")
    channel: str = Field(min_length=1)
    bitrate: int = Field(default=1_000_000, ge=10_000, le=1_000_000)
    nodes: Annotated[tuple[NodeId, ...], Field(min_length=1, max_length=32)]
    sync: SyncSource = "auto"
    code_sequence: CodeSequence = "keep"
    heartbeat_ms: int = Field(default=200, ge=10, le=10_000)
    answer_s: float = Field(default=0.3, ge=0.01, le=5.0)
    answer_tries: int = Field(default=3, ge=1, le=10)
    late_s: float = Field(default=0.1, ge=0.001, le=5.0)
    status_period_s: float = Field(default=5.0, ge=0.0, le=3600.0)

    @field_validator("nodes")
    @classmethod
    def _once_each(cls, nodes: tuple[int, ...]) -> tuple[int, ...]:
        twice = sorted({node for node in nodes if nodes.count(node) > 1})
        if twice:
            raise ValueError(f"nodes {twice} are given twice; each has its own number")
        return nodes

    @property
    def where(self) -> str:
        return f"{self.interface}:{self.channel}"
