"""Which driver serves which name in a configuration; loaded when it is asked for."""

from importlib import import_module

from drivers.driver import Driver

DRIVERS = {"latch-board": "drivers.latch_board:LatchBoard"}


def driver_class(name: str) -> type[Driver]:
    """The class behind ``name``.

    Raises:
        KeyError: there is no such driver.
    """
    module, _, attribute = DRIVERS[name].partition(":")
    found: type[Driver] = getattr(import_module(module), attribute)
    return found
