"""Options of a device's table in the configuration, beside id and driver."""

from pydantic import BaseModel, ConfigDict


class DriverOptions(BaseModel):
    """Options of one driver: flat keys, with units in their names and with bounds.

    Each driver has a child of it, which is validated here once, and is frozen.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False
    )

    @property
    def where(self) -> str:
        """Port or bus, for messages; a child without ``port`` overrides it."""
        return str(getattr(self, "port", ""))
