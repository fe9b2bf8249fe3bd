"""Options of a device's table in the configuration, beside id and driver."""

from traverse.strict_toml.reader import StrictModel


class DriverOptions(StrictModel):
    """Options of one driver: flat keys, with units in their names and with bounds.

    Each driver has a child of it, which is validated here once, and is frozen.
    """

    @property
    def where(self) -> str:
        """Port or bus, for messages; a child without ``port`` overrides it."""
        return str(getattr(self, "port", ""))
