"""Which driver serves which name in a configuration; loaded when it is asked for.

A new driver is a file with a child of `Driver` and its options, and an entry here.
"""

from importlib import import_module

from drivers.driver import Driver

DRIVERS = {
    "canopen": "drivers.canopen:CanOpen",
    "latch-board": "drivers.latch_board:LatchBoard",
    "amt21": "drivers.amt21:Amt21",
    "modbus": "drivers.modbus:Modbus",
    "rls": "drivers.rls:Rls",
    "microscribe": "drivers.microscribe:Microscribe",
    "gpio": "drivers.gpio:Gpio",
    "evdev": "drivers.evdev:Evdev",
    "replay": "drivers.replay:Replay",
}
"""Name in the configuration: module and class."""

EXTRAS = {"canopen": "can", "modbus": "modbus", "gpio": "gpio"}
"""Drivers that need an extra of this package, by the name of the extra."""


class DriverUnavailableError(Exception):
    """A library that the driver needs is not installed; the text says which extra."""


def driver_class(name: str) -> type[Driver]:
    """The class behind ``name``.

    Raises:
        KeyError: there is no such driver.
        DriverUnavailableError: it needs what is not installed.
    """
    module, _, attribute = DRIVERS[name].partition(":")
    try:
        found: type[Driver] = getattr(import_module(module), attribute)
    except ModuleNotFoundError as error:
        if name not in EXTRAS:
            raise
        raise DriverUnavailableError(
            f"driver {name!r} needs {error.name}, which is not installed; "
            f"pip install 'traverse-cmm[{EXTRAS[name]}]'"
        ) from error
    return found
