"""`traverse probe`: probes of the library, checked."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.common.campaign_inputs import CampaignFolder
from traverse.cli.common.options import CommandGroup, Json
from traverse.cli.common.refusals import FAILED, print_report, refusals, refuse
from traverse.cli.control import use_probe

if TYPE_CHECKING:
    from traverse.daemon.pose.probe_library import LibraryProbe, ProbeLibrary


probe = CommandGroup("probe", help="Probes of the library.")
probe.command("use")(use_probe)


@probe.command("pivot")
def pivot(
    campaign: CampaignFolder,
    *,
    arm: Path,
    library: Path | None = None,
    name: str | None = None,
    cone: str | None = None,
    limit_mm: Annotated[float, typer.Option(min=0.0)] = 0.05,
    write: bool = False,
    yes: bool = False,
    as_json: Json = False,
) -> None:
    """Find a probe's vector from poses with its ball in a cone.

    Exit status 1 where it is beyond the limit and not confirmed.

    Args:
        arm: Arm file, identified.
        library: Probe library to compare with.
        name: Which probe of the library it is.
        cone: Artefact, where there are several.
        limit_mm: A larger change needs confirmation.
        write: Write the result into the library.
        yes: Do not ask for confirmation beyond the limit.
    """
    with refusals():
        from traverse.cli.probe.pivot import pivoted, write_vector
        from traverse.kinematics.arm_file.arm import read_arm

        probes, chosen = _chosen(library, name, write=write)
        try:
            check = pivoted(campaign, read_arm(arm), chosen, cone)
        except ValueError as error:
            if type(error) is not ValueError:
                raise
            refuse(str(error))
        print_report(check.report(), check.lines(), as_json=as_json)
        if check.off_mm > limit_mm and not yes and not _confirmed(limit_mm, write):
            raise typer.Exit(FAILED)
        if write and library is not None and probes is not None and chosen is not None:
            write_vector(library, probes, chosen.name, check.pivot)
            typer.echo(f"{library}: {chosen.name} has the vector found", err=True)


def _chosen(
    library: Path | None, name: str | None, *, write: bool
) -> tuple["ProbeLibrary | None", "LibraryProbe | None"]:
    """The probe of the library; None for the arm's own."""
    from traverse.daemon.pose.probe_library import read_probes

    if (library is None) != (name is None):
        refuse("--library and --name go together: give both, or neither")
    if library is None or name is None:
        if write:
            refuse("--write needs --library and --name")
        return None, None
    probes = read_probes(library)
    chosen = probes.named(name)
    if chosen is None:
        known_names = ", ".join(probes.names)
        refuse(f"{library} has no probe {name!r}; it has: {known_names}")
    return probes, chosen


def _confirmed(limit_mm: float, write: bool) -> bool:
    """Ask for confirmation at a terminal; elsewhere refuse."""
    text = f"the vector has changed by more than {limit_mm:g} mm"
    if write and sys.stdin.isatty():
        return typer.confirm(f"{text}; write it all the same?", err=True)
    typer.echo(f"{text}; check probe, cone and arm, or give --yes", err=True)
    return False
