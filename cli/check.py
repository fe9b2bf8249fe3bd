"""`traverse check`: everything that is wrong with a file."""

import contextlib
import json
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path

import typer

from traverse.cli.common.options import Json
from traverse.cli.common.refusals import REFUSED
from traverse.strict_toml.problems import FileError, Problem, toml_table, toml_text


def check(
    file: Path,
    as_json: Json = False,
) -> None:
    """Check the files of an arm, a daemon or a campaign.

    Knows arm files, configurations, campaigns, nominal places, limits, laboratories,
    plans and probe libraries.

    A campaign is given by its folder or its campaign.toml; its poses are checked too,
    and with a configuration the arm file and the probe library that it names.
    Reports all mistakes at once. Exit status 2 if there are any.

    Args:
        file: An arm file, a configuration, a campaign, ...
    """
    from traverse.daemon.inputs import StartupError

    if (file / "campaign.toml").is_file():
        file /= "campaign.toml"
    kind, read = _reader(file)
    content: object = None
    wrong: list[FileError] | None = None
    try:
        if file.is_file() and not file.stat().st_size:
            problem = "is empty; expected an arm file, a configuration, a campaign, ..."
            raise FileError(file, problem)
        content = read(file)
    except StartupError as error:
        wrong = error.files
    except FileError as error:
        wrong = [error]
    if as_json:
        problems = [
            {"file": wrong_file.source, "where": p.where, "message": p.message}
            for wrong_file in wrong or ()
            for p in wrong_file.problems
        ]
        doubts = list(_doubts(content, file.parent))
        report = {
            "file": str(file),
            "kind": kind,
            "problems": problems,
            "doubts": doubts,
        }
        typer.echo(json.dumps(report, indent=None if wrong is None else 1))
    elif wrong is not None:
        typer.echo("\n".join(map(str, wrong)), err=True)
    else:
        name = kind.replace("'s", "")
        typer.echo(f"{file}: valid {name}")
        for doubt in _doubts(content, file.parent):
            typer.echo(f"{file}: {doubt}", err=True)
    if wrong is not None:
        raise typer.Exit(REFUSED)


def _doubts(content: object, folder: Path) -> Iterator[str]:
    """Question implausible values, and certificates that end soon."""
    from traverse.broker.certificates import warning_of_end
    from traverse.broker.credentials import CredentialsError, certificate_ends
    from traverse.daemon.inputs import Inputs, address_of
    from traverse.kinematics.arm_file.arm import Arm
    from traverse.kinematics.importers.unit_doubts import arm_doubts

    if isinstance(content, Arm):
        yield from arm_doubts(content)
    yield from getattr(content, "notes", ())  # of a campaign
    if isinstance(content, Inputs) and (section := content.configuration.broker):
        try:
            ends = certificate_ends(address_of(section, folder))
        except CredentialsError as error:
            yield f"broker.{error}"
            return
        for name, end in ends.items():
            if warning := warning_of_end(name, end, datetime.now(UTC)):
                yield str(warning)


def _reader(file: Path) -> tuple[str, Callable[[Path], object]]:
    """The kind of the file, by its schema or its tables, and its reader."""
    try:
        tables = toml_table(toml_text(file), str(file))
    except FileError:
        return "arm file", _read_arm  # which reports the mistakes
    schema = str(tables.get("schema", ""))
    for prefix, names, kind, reader in _KINDS:
        if schema.startswith(f"traverse/{prefix}/") or any(n in tables for n in names):
            return kind, reader
    return "arm file", _read_arm


def _read_arm(path: Path) -> object:
    from traverse.kinematics.arm_file.arm import read_arm
    from traverse.kinematics.effects.arm_effects import effects_from_arm
    from traverse.kinematics.uncertainty.arm_covariance import read_parameter_covariance

    arm = read_arm(path)
    try:
        effects = effects_from_arm(arm)
    except ValueError as error:
        raise FileError(path, [Problem("effects", str(error))]) from error
    try:
        read_parameter_covariance(path, arm, effects, effects)
    except ValueError as error:
        key = "identification.covariance_file"
        raise FileError(path, [Problem(key, str(error))]) from error
    return arm


def _read_simulator(path: Path) -> object:
    from traverse.simulator.config import SimulatorConfig, config_problems
    from traverse.strict_toml.reader import read_strict

    return read_strict(path, SimulatorConfig, config_problems)


def _by(module: str, name: str) -> Callable[[Path], object]:
    """Return a reader that is imported on first use, which keeps --help quick."""

    def read(path: Path) -> object:
        from traverse.strict_toml.reader import read_strict

        reader = getattr(import_module(f"traverse.{module}"), name)
        return read_strict(path, reader) if isinstance(reader, type) else reader(path)

    return read


_read_probes = _by("daemon.pose.probe_library", "read_probes")
_read_limits = _by("lab.acceptance.limits", "Limits")
_read_laboratory = _by("lab.acceptance.laboratory", "Laboratory")
_read_nominal = _by("lab.alignment.nominal", "read_nominal")
_read_plan = _by("lab.collection.plan", "PlanFile")


def _read_daemon(path: Path) -> object:
    from traverse.daemon.inputs import read_inputs

    # Without a broker it may run with an embedded one.
    return read_inputs(path, True)


def _read_campaign(path: Path) -> object:
    from traverse.lab.campaign.campaign import read_campaign
    from traverse.lab.campaign.campaign_file import read_campaign_file
    from traverse.tables.reading import open_table

    poses = path.parent / read_campaign_file(path).poses
    joints: list[str] = []
    # Its reader below reports what is wrong with it.
    with contextlib.suppress(FileError), open_table(poses) as table:
        joints = [c.removesuffix("_rad") for c in table.header if c.endswith("_rad")]
    return read_campaign(path.parent, joints, several_tools=True, orientations=True)


# Part of the schema, tables that identify it too, name, reader.
_KINDS: tuple[tuple[str, tuple[str, ...], str, Callable[[Path], object]], ...] = (
    ("simulator", ("motion",), "simulator's configuration", _read_simulator),
    ("probes", ("probes",), "probe library", _read_probes),
    ("acceptance-limits", ("mpe",), "file of acceptance limits", _read_limits),
    ("laboratory", ("laboratory",), "file of a laboratory", _read_laboratory),
    ("nominal", (), "nominal places", _read_nominal),
    ("collection-plan", ("steps",), "collection plan", _read_plan),
    ("campaign", ("poses",), "campaign", _read_campaign),
    ("daemon", ("arm", "broker", "device"), "daemon's configuration", _read_daemon),
)
