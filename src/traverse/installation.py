"""Libraries that a part of Traverse needs, and how to get one that is missing.

An extra is a group of them, as pyproject.toml lists it.
"""

import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

EXTRAS = {
    "serial": "daemon",
    "cobs": "daemon",
    "mcap": "daemon",
    "amqtt": "demo",
    "scipy": "lab",
    "matplotlib": "lab",
    "jinja2": "lab",
    "ezdxf": "lab",
    "nicegui": "page",
    "fastapi": "page",
    "starlette": "page",
    "pyarrow": "parquet",
    "psycopg": "fleet",
    "distributed": "cluster",
    "can": "can",
    "canopen": "can",
    "pymodbus": "modbus",
    "gpiod": "gpio",
    "pynput": "keys",
    "evdev": "keys",
    "foxglove": "live",
    "asyncua": "opcua",
    "mcap_ros2": "ros",
    "lxml": "certificate",
    "signxml": "certificate",
    "cryptography": "signed",
}
"""Extra with a library, by the imported name."""

_NOT_IN_DEBIAN = {
    "cluster": "leave --scheduler out",
    "keys": "use `traverse gateway lines`",
}
_OTHER_PACKAGES = {
    **dict.fromkeys(("lab", "certificate", "ros"), "traverse-lab"),
    **dict.fromkeys(("fleet", "parquet"), "traverse-fleet"),
}
PACKAGED = "/usr/lib/traverse"


def missing(feature: str, library: str, extra: str) -> str:
    """Say that a feature needs a library that is not installed, and how to get it."""
    return f"{feature} needs {library}, which is not installed; {remedy(extra)}"


def remedy(extra: str) -> str:
    """Say how to install an extra, by the way in which Traverse was installed."""
    if sys.prefix.endswith(PACKAGED):
        if extra in _NOT_IN_DEBIAN:
            return f"the Debian packages do not have it: {_NOT_IN_DEBIAN[extra]}"
        package = _OTHER_PACKAGES.get(extra, "traverse")
        return (
            f"install the Debian package {package}, of the same version as traverse: "
            f"sudo apt-get install ./{package}_{version('traverse-cmm')}_*.deb"
        )
    checkout = Path(__file__).resolve().parents[2]
    if (checkout / "Makefile").is_file():
        return f"in {checkout} run: make venv"
    install = f"uv pip install --python {sys.executable}"
    if find_spec("pip"):
        install = f"{sys.executable} -m pip install"
    return f"install the extra `{extra}`: {install} 'traverse-cmm[{extra}]'"
