"""Serial ports and CAN interfaces of this computer."""

from pathlib import Path

CAN_TYPE = "280"  # ARPHRD_CAN of Linux
PATTERNS = ("ttyUSB*", "ttyACM*", "ttyAMA*", "ttyTHS*", "ttymxc*")


def serial_ports(devices: Path = Path("/dev")) -> list[Path]:
    """Return serial ports, those with a name that stays first.

    Args:
        devices: The folder of device files.
    """
    named = sorted((devices / "serial" / "by-id").glob("*"))
    targets = {path.resolve() for path in named}
    unnamed = sorted(path for name in PATTERNS for path in devices.glob(name))
    return named + [path for path in unnamed if path.resolve() not in targets]


def can_interfaces(networks: Path = Path("/sys/class/net")) -> list[str]:
    """Return the names of CAN interfaces.

    Args:
        networks: The kernel's folder of network interfaces.
    """
    return sorted(
        folder.name
        for folder in networks.glob("*")
        if (kind := folder / "type").is_file()
        and kind.read_text("ascii").strip() == CAN_TYPE
    )
