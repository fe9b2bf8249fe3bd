"""Inputs and errors of commands that adjust campaigns."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.common.options import campaign_folder
from traverse.cli.common.refusals import FAILED, end, refusals, refuse

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Arm
    from traverse.lab.campaign.campaign import Campaign

CampaignFolder = Annotated[
    Path, typer.Argument(help="Folder with campaign.toml.", callback=campaign_folder)
]
Family = Annotated[
    Path | None,
    typer.Option(
        help="File of `traverse fleet family --out`: take parameters as the arms of "
        "this design have them."
    ),
]
PriorPatterns = Annotated[
    list[str] | None,
    typer.Option(help="Only those of it, e.g. 'J3.*'. Repeatable; default all."),
]


def check_prior(family: Path | None, prior: list[str] | None) -> None:
    """Refuse patterns without a family."""
    if prior and family is None:
        refuse("--prior says which parameters of a family count; give --family, too")


def read_noted(
    folder: Path, arm: Path, family: Path | None, prior: list[str] | None
) -> "tuple[Arm, Campaign]":
    from traverse.lab.runs.inputs import read_inputs

    check_prior(family, prior)
    design, campaign = read_inputs(folder, arm, family, prior or [])
    for note in campaign.notes:
        typer.echo(f"{folder}: {note}", err=True)
    return design, campaign


@contextmanager
def adjustment_errors() -> Iterator[None]:
    """End with exit status 2 where inputs do not fit, 1 where an adjustment breaks."""
    from traverse.lab.adjustment import IdentificationError
    from traverse.lab.runs.inputs import BreakdownError

    with refusals(IdentificationError):
        try:
            yield
        except BreakdownError as error:
            end(FAILED, str(error))
