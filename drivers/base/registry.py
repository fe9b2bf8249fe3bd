"""Drivers by name in the configuration; loaded on demand.

A new driver is a file with a child of `Driver` and its options, and an entry here, or
in another package's entry points.
"""

from importlib import import_module

from traverse.drivers.base.driver import Driver
from traverse.extensions import (
    DRIVER_GROUP,
    load_extension_class,
    offered_extensions,
)
from traverse.installation import missing

DRIVERS = {
    "canopen": "traverse.drivers.canopen.driver:CanOpenDriver",
    "latch-board": "traverse.drivers.latch_board.driver:LatchBoardDriver",
    "amt21": "traverse.drivers.amt21.driver:Amt21Driver",
    "modbus": "traverse.drivers.modbus.driver:ModbusDriver",
    "rls": "traverse.drivers.rls.driver:RlsDriver",
    "microscribe": "traverse.drivers.microscribe.driver:MicroscribeDriver",
    "text-line": "traverse.drivers.text_line.driver:TextLineDriver",
    "gpio": "traverse.drivers.triggers.gpio:GpioDriver",
    "evdev": "traverse.drivers.triggers.evdev:EvdevDriver",
    "replay": "traverse.drivers.replay:ReplayDriver",
}
"""Name in the configuration: module and class."""

EXTRAS = {"canopen": "can", "modbus": "modbus", "gpio": "gpio"}
"""Drivers that need another extra of this package than `daemon`."""


class DriverUnavailableError(Exception):
    """A library that the driver needs is not installed; states how to install it."""


def driver_class(name: str) -> type[Driver]:
    """Import the class of a driver.

    Raises:
        KeyError: there is no such driver.
        DriverUnavailableError: a library is not installed.
        BrokenExtensionError: another package offers it, and it cannot be used.
    """
    if name not in DRIVERS:
        return load_extension_class(DRIVER_GROUP, name, Driver)  # type: ignore[type-abstract]  # it loads a child
    module, _, attribute = DRIVERS[name].partition(":")
    try:
        cls: type[Driver] = getattr(import_module(module), attribute)
    except ModuleNotFoundError as error:
        raise DriverUnavailableError(
            missing(f"driver {name!r}", str(error.name), EXTRAS.get(name, "daemon"))
        ) from error
    return cls


def driver_names() -> tuple[str, ...]:
    return tuple(dict.fromkeys((*DRIVERS, *offered_extensions(DRIVER_GROUP))))
