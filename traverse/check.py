"""`traverse check`: everything that is wrong with a file."""

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer


def check(
    file: Annotated[
        Path, typer.Argument(help="An arm file, a configuration, a campaign, ...")
    ],
    as_json: Annotated[
        bool, typer.Option("--json", help="Report as JSON on standard output.")
    ] = False,
) -> None:
    """Check an arm file, a probe library, a configuration, or a campaign.

    A campaign is given by its folder or its campaign.toml; its poses are checked too,
    and with a configuration the arm file and the probe library that it names.
    Says everything that is wrong with it, at once. Exit status 2 if anything is.
    """
    from daemon.startup import StartupError  # noqa: PLC0415 - keeps --help quick
    from kinematics.arm_file import FileError  # noqa: PLC0415

    if (file / "campaign.toml").is_file():
        file /= "campaign.toml"
    kind, read = _reader(file)
    try:
        read(file)
    except (FileError, StartupError) as error:
        wrong = error.files if isinstance(error, StartupError) else [error]
        if as_json:
            problems = [
                {"file": one.source, "where": p.where, "message": p.message}
                for one in wrong
                for p in one.problems
            ]
            report = {"file": str(file), "kind": kind, "problems": problems}
            typer.echo(json.dumps(report, indent=1))
        else:
            typer.echo("\n".join(str(one) for one in wrong), err=True)
        raise typer.Exit(2) from error
    if as_json:
        typer.echo(json.dumps({"file": str(file), "kind": kind, "problems": []}))
    else:
        typer.echo(f"{file}: a good {kind}")


def _reader(file: Path) -> tuple[str, Callable[[Path], object]]:
    """What the file is, by its schema or its tables, and what reads it."""
    import tomllib  # noqa: PLC0415

    from daemon.probes import read_probes  # noqa: PLC0415
    from daemon.startup import read_inputs  # noqa: PLC0415
    from kinematics.arm_file import read_arm, read_strict  # noqa: PLC0415
    from simulator.config import SimulatorConfig, config_problems  # noqa: PLC0415

    try:
        tables = tomllib.loads(file.read_text("utf-8"))
    except (OSError, ValueError):
        return "arm file", read_arm  # whose reader says what is wrong
    schema = str(tables.get("schema", ""))
    if schema.startswith("traverse/simulator/") or "motion" in tables:
        return "simulator's configuration", lambda path: read_strict(
            path, SimulatorConfig, config_problems
        )
    if schema.startswith("traverse/probes/") or "probes" in tables:
        return "probe library", read_probes
    if schema.startswith("traverse/campaign/") or "poses" in tables:
        return "campaign", _read_campaign
    if "arm" in tables or "broker" in tables or "device" in tables:
        # Who has no broker yet may run with one that is embedded.
        return "daemon's configuration", lambda path: read_inputs(path, True)
    return "arm file", read_arm


def _read_campaign(path: Path) -> object:
    """Read a campaign with whatever joints its poses have."""
    from lab.campaign import read_campaign  # noqa: PLC0415
    from lab.campaign_file import read_campaign_file  # noqa: PLC0415

    poses = path.parent / read_campaign_file(path).poses
    header = ""
    with contextlib.suppress(OSError, ValueError), poses.open(encoding="utf-8") as file:
        header = file.readline()
    columns = (column.strip() for column in header.split(","))
    joints = [c.removesuffix("_rad") for c in columns if c.endswith("_rad")]
    return read_campaign(path.parent, joints)
