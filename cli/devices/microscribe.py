"""`traverse microscribe`: from an arm that stores its geometry to a running daemon."""

import json
import re
from pathlib import Path
from typing import Annotated

import typer

from traverse.cli.common.options import CommandGroup, Force, Json
from traverse.cli.common.refusals import (
    check_target,
    device_errors,
    print_report,
    refusals,
    refuse,
)
from traverse.plurals import counted

CONFIGURATION = Path(__file__).with_name("microscribe.toml.template")

microscribe = CommandGroup(
    "microscribe",
    help="MicroScribe arms: make an arm file. From the geometry that the arm stores. "
    "The daemon must not be using the port.",
)


@microscribe.command("arm-file")
def arm_file(
    *,
    port: str,
    out: Annotated[Path, typer.Option("--out", "-o")],
    baud_rate: int | None = None,
    name: str | None = None,
    device: str = "microscribe",
    radius_mm: Annotated[float, typer.Option(min=0.0)] = 0.0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write an arm file and, beside it, `traverse.toml` to measure with at once.

    The arm must be in its home position while it is switched on.

    Args:
        port: Serial port of the arm.
        out: The arm file to write.
        baud_rate: Try this one only; default all.
        name: Name of the arm; default the one that it reports.
        device: Its id in the daemon's configuration.
        radius_mm: Radius of the ball; 0 for a pointed stylus.
    """
    from traverse.cli.devices.microscribe_arm import (
        arm_from_microscribe,
        query_microscribe,
    )
    from traverse.kinematics.arm_file.arm import write_arm
    from traverse.strict_toml.files import text_of
    from traverse.strict_toml.writing import write_atomically

    config = out.with_name("traverse.toml")
    _check_names(out, config, baud_rate, device, force=force)
    with refusals(), device_errors():
        identity, description = query_microscribe(port, baud_rate, name)
        arm = arm_from_microscribe(description, device, radius_mm)
        text = text_of(CONFIGURATION).format(
            name=identity.name,
            file=config.name,
            arm=json.dumps(out.name),
            device=json.dumps(device),
            port=json.dumps(port),
            baud_rate=identity.baud_rate,
            id=device,
        )
        write_arm(out, arm)
        write_atomically(config, text)
    report = {
        "arm_file": str(out),
        "configuration": str(config),
        "arm": arm.name,
        "says": {
            name: getattr(identity, name)
            for name in ("box", "product", "model", "serial", "version")
        },
        "protocol": identity.framing.name,
        "baud_rate": identity.baud_rate,
        "counts_per_turn": list(identity.moduli),
        "beta_rad": description.kinematics.beta_rad,
    }
    lines = (
        f"{identity.name}, {identity.framing.name} at {identity.baud_rate} baud",
        f"{out}: arm {arm.name} with {counted(len(arm.joints), 'joint')}",
        f"{config}: measure with",
        f"    traverse run {config} --embedded-broker",
    )
    print_report(report, lines, as_json=as_json)


def _check_names(
    out: Path, config: Path, baud_rate: int | None, device: str, *, force: bool
) -> None:
    """Refuse impossible options before a request to the arm."""
    from traverse.drivers.microscribe.session import BAUD_RATES

    if baud_rate is not None and baud_rate not in BAUD_RATES:
        rates = ", ".join(map(str, sorted(BAUD_RATES)))
        refuse(f"--baud-rate {baud_rate}: expected one of {rates}")
    if not re.fullmatch(r"[A-Za-z0-9_-]+", device):
        refuse(f"--device {device!r}: expected letters, digits, _ and -")
    if out.name == config.name:
        refuse(f"--out {out}: the configuration beside it has this name")
    for path in (out, config):
        check_target(path, force=force)
