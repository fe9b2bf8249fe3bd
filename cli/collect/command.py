"""`traverse collect`: a campaign collected at the terminal, point by point."""

import json
from pathlib import Path
from typing import Annotated

import typer

from traverse.cli.common.broker_options import BrokerOptions
from traverse.cli.common.options import Json
from traverse.cli.common.refusals import FAILED, refusals, refuse
from traverse.strict_toml.files import locked_folder, text_of


def collect(
    campaign: Path,
    *,
    arm: Path,
    out: Path | None = None,
    each: Annotated[int, typer.Option(min=1, max=100_000)] = 25,
    allow: str = "surface_unknown,empirical",
    broker: BrokerOptions,
    as_json: Json = False,
) -> None:
    """Collect the poses of a campaign, guided.

    Shows what to touch, and how often. Where a plan.toml lies beside the campaign
    (`traverse verify --plan` writes one) it is followed step by step.

    Points that the daemon captures count for the artefact that is shown, or for the
    one in their label. Each is on the disk before it counts, and a collection that
    was ended continues where it was. Keys, or lines on standard input: n (next),
    p (previous), u (undo), q (quit); after a question y (the touch is right), b (begin
    with it). Exit status 1: ended before everything was touched.

    Args:
        campaign: The campaign.toml, or its folder; poses are put beside it.
        arm: The arm file that the daemon uses.
        out: Folder to collect into; what the campaign has beside its poses is copied
            there first.
        each: Touches of every feature; not with a plan.
        allow: Quality flags that a point may have, with commas.
    """
    from traverse.kinematics.arm_file.arm import read_arm

    address = broker.address()
    with refusals():
        from traverse.cli.collect.session import collection_of, run_collection
        from traverse.cli.common.point_flags import allowed_flags
        from traverse.lab.campaign import campaign_file
        from traverse.lab.collection.collection import collection_report

        flags = allowed_flags(allow)
        if campaign.is_dir():
            campaign /= "campaign.toml"
        if out is not None:
            campaign = _copied(campaign, out)
        file = campaign_file.read_campaign_file(campaign)
        for problem in campaign_file.example_problems(file):
            typer.echo(f"{campaign}: {problem}", err=True)
        if not file.poses.endswith(".csv"):
            refuse(
                f"{campaign}: poses is {file.poses!r}; what is collected point by "
                'point is a table: poses = "poses.csv"'
            )
        for artefact in file.artefacts:
            if artefact.reads_lengths:
                refuse(
                    f"{campaign}: {artefact.id!r} reads a length at every pose, which "
                    "no point has; make the table of its poses otherwise"
                )
        model = read_arm(arm)
        with locked_folder(campaign.parent, "collects in it"):
            collection = collection_of(file, campaign.parent, model, each)
            collection.resume()
            run_collection(collection, model.name, address, flags, quiet=as_json)
    if as_json:
        typer.echo(json.dumps(collection_report(collection), indent=1))
    if collection.unfinished():
        raise typer.Exit(FAILED)


def _copied(campaign: Path, out: Path) -> Path:
    """Copy a campaign.toml, its plan and lists of points; return the copy.

    An existing copy has to be equal.
    """
    from traverse.lab.artefacts.points import Points
    from traverse.lab.campaign.campaign_file import CampaignFile
    from traverse.strict_toml.reader import read_strict
    from traverse.strict_toml.writing import write_atomically

    lists = [
        artefact.points_mm
        for artefact in read_strict(campaign, CampaignFile).artefacts
        if isinstance(artefact, Points) and isinstance(artefact.points_mm, str)
    ]
    names = [campaign.name, "plan.toml", *lists]
    texts = {
        name: text_of(campaign.parent / name)
        for name in names
        if (campaign.parent / name).is_file()
    }
    out.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        copy = out / name
        if copy.exists() and text_of(copy) != text:
            refuse(
                f"{copy} differs from that of {campaign.parent}; name another folder"
            )
        write_atomically(copy, text)
    return out / campaign.name
