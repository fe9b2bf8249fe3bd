"""The `[[device]]` tables: id, driver, and that driver's options."""

from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    SerializeAsAny,
    create_model,
    field_validator,
)

from traverse.drivers.base.driver import DriverOptions
from traverse.drivers.base.registry import (
    DriverUnavailableError,
    driver_class,
    driver_names,
)
from traverse.extensions import BrokenExtensionError
from traverse.strict_toml.problems import unknown_name_message


class DeviceSection(DriverOptions):
    """A device and its driver; subclasses add the driver's options."""

    id: str = Field(pattern=r"^[A-Za-z0-9_-]+$")
    driver: str

    @classmethod
    def variant(cls, table: object) -> "type[DeviceSection]":
        """Select the class of a table by its driver."""
        name = table.get("driver") if isinstance(table, Mapping) else None
        return section_class(str(name))

    @property
    def options(self) -> DriverOptions:
        options = {name: value for name, value in self if name not in ("id", "driver")}
        return driver_class(self.driver).options_class.model_construct(**options)


class UnavailableDriverSection(DeviceSection):
    """Table of an unknown driver; refused for that alone, not for its other keys."""

    model_config = ConfigDict(extra="ignore")

    @field_validator("driver")
    @classmethod
    def _refuse(cls, name: str) -> str:
        try:
            driver_class(name)
        except KeyError:
            text = unknown_name_message("driver", name, driver_names())
        except (DriverUnavailableError, BrokenExtensionError) as error:
            text = str(error)
        raise ValueError(text)


@cache
def section_class(driver: str) -> type[DeviceSection]:
    try:
        options = driver_class(driver).options_class
    except (KeyError, DriverUnavailableError, BrokenExtensionError):
        return UnavailableDriverSection
    bases: tuple[type[Any], ...] = (DeviceSection, options)
    return create_model(f"{options.__name__}Section", __base__=bases)


AnyDevice = Annotated[
    SerializeAsAny[DeviceSection], BeforeValidator(DeviceSection.from_table)
]
