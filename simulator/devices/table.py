"""`[[device]]` of the simulator's configuration: what all kinds of devices share."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, ClassVar

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    SerializeAsAny,
    field_validator,
)

from traverse.simulator.devices.kinds import DEFAULT, KINDS, class_named
from traverse.strict_toml.reader import StrictModel


class DeviceTable(StrictModel):
    """What every device has; each kind adds its own keys.

    Attributes:
        FAULTS: Kinds of `[[fault]]` that this kind of device plays.
        BY_CHANNEL: Each encoder is polled by itself, so that a fault of the line may be
            of one channel alone.
        MOST_CHANNELS: Encoders that it can have.
        id: Of the device; the arm file's sources are "<id>/<channel>".
        encoder_turns: Turns after which the counts wrap.
    """

    FAULTS: ClassVar[frozenset[str]] = frozenset()
    BY_CHANNEL: ClassVar[bool] = False
    MOST_CHANNELS: ClassVar[int] = 32

    kind: str = DEFAULT
    id: str = Field(min_length=1)
    encoder_turns: int = Field(default=1, ge=1)

    @classmethod
    def variant(cls, table: object) -> "type[DeviceTable]":
        """Select the class of a table by its kind."""
        name = table.get("kind", DEFAULT) if isinstance(table, Mapping) else None
        kind = KINDS.get(str(name))
        return UnknownDevice if kind is None else class_named(kind.table)

    def channel_problems(
        self, counts_per_turn: Sequence[int]
    ) -> Iterator[tuple[str, str]]:
        """Report what does not match the arm file's encoders on this device.

        Args:
            counts_per_turn: By channel.

        Yields:
            A key of the table and what is wrong with it.
        """
        del counts_per_turn
        yield from ()


class UnknownDevice(DeviceTable):
    """What is of no known kind: refused for that alone, not for its other keys."""

    model_config = ConfigDict(extra="ignore")

    @field_validator("kind")
    @classmethod
    def _refuse(cls, kind: str) -> str:
        known = ", ".join(sorted(KINDS))
        raise ValueError(f"unknown kind of device '{kind}'; known: {known}")


def device_from_table(table: object) -> DeviceTable:
    """Make a table of the class of its kind."""
    return (
        table
        if isinstance(table, DeviceTable)
        else DeviceTable.variant(table).model_validate(table)
    )


AnyDevice = Annotated[SerializeAsAny[DeviceTable], BeforeValidator(device_from_table)]
